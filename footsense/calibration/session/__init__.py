"""Sessions on a test stand: live guidance while recording, and reading of the recordings."""
