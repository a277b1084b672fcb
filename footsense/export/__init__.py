"""Export of recordings as a table (CSV) and as a plot."""
