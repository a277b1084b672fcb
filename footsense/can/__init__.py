"""CAN: sends forces and reports, receives commands, and logs the sent frames."""
