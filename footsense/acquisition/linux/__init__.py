"""Devices of a Linux computer: I2C adapters, GPIO lines, serial ports; one file for each vendor library."""
