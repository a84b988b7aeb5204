"""What a person runs: jobs, reports and the command line."""
