"""Baselines: unloaded reading of each element by tare and drift tracking, and contact detection."""
