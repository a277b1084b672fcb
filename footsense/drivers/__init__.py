"""Chips as commands, and the scanner that runs them in time. No driver knows whether its bus is simulated."""
