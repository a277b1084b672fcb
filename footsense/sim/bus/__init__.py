"""I2C buses and serial lines in bit time."""
