"""Probe of the buses before the first scan: answering addresses, chip identities, readings of the feet."""
