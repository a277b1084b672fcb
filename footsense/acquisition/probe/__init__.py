"""Checks before the first scan: answering I2C addresses, chip identities, readings of the unloaded feet."""
