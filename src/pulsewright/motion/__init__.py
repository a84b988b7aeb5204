"""G-code, machines, planning: what is asked, and exactly when each point is passed."""
