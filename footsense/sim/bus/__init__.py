"""Simulated I2C buses and serial ports; every transfer advances virtual time by its bits on the wire."""
