"""Command `footsense probe`: chips on the buses, and diagnosis of faults."""
