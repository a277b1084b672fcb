"""`footsense evaluate`."""
