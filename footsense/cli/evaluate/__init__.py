"""Command `footsense evaluate`: force errors of a recorded test-stand session."""
