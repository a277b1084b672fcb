"""Command `footsense run`: the service (daemon)."""
