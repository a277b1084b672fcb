"""Force sensors of a test stand, behind the port `ReferenceSensor`."""
