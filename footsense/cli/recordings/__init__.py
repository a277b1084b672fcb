"""Commands that read recordings: `footsense export`, `recover` and `replay`."""
