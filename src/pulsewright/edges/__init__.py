"""Pin changes: recording, timing and the positions they mean."""
