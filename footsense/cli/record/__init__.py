"""`footsense record`."""
