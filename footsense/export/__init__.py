"""Export of recordings as a table (CSV)."""
