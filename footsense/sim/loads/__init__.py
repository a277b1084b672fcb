"""Simulated true loads (force and contact normal) of the feet over time."""
