"""Command `footsense record`: guided session on a test stand."""
