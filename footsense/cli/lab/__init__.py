"""`footsense lab`."""
