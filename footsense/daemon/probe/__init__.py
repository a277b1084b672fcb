"""The configured buses and feet checked before a first walk."""
