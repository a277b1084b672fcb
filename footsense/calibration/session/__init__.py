"""Sessions on a test stand: guidance while recording, and reading of the recordings."""
