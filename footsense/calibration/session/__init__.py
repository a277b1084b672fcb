"""One session on a test stand: as it is recorded, and as it is read back."""
