"""Check of the configured I2C buses and feet before the robot walks (`footsense probe`)."""
