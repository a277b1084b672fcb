"""Drivers of reference force sensors of a test stand, behind the interface `ReferenceSensor`."""
