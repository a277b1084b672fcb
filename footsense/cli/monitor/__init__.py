"""Command `footsense monitor`: forces and states received from CAN."""
