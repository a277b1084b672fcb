"""Codes to `CapFrame`: chips as commands, and the scanner that runs them in time. No driver knows of simulation."""
