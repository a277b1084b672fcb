"""Simulated CAN interface, its transmit queue and its controller, frame by frame in virtual time."""
