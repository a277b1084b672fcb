"""Export of recordings as tables (CSV, Parquet) and as a plot."""
