"""Check of the configured buses and feet before a first walk."""
