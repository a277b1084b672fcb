"""Linux devices: I2C adapters, GPIO lines, serial ports; one module per vendor library."""
