"""Recordings in other forms: tables of text (CSV) or columns (Parquet), and a picture."""
