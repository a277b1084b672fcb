"""Studies of time against error."""
