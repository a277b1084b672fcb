"""Forces to CAN, commands from CAN, and the log of both."""
