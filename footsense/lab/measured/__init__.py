"""Measured sensors of others, read from their published data."""
