"""`footsense monitor`."""
