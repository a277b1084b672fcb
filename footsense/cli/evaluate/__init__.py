"""Command `footsense evaluate`: errors of a recorded session."""
