"""Register maps: one hand-written source, everything else generated."""
