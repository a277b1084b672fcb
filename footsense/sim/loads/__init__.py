"""Loads of the feet over time."""
