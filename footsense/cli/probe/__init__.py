"""Command `footsense probe`: find the chips on the buses, and diagnose faults."""
