"""`footsense probe`."""
