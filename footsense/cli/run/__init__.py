"""Command `footsense run`: the daemon."""
