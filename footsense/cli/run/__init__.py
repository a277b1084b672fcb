"""`footsense run`."""
