"""Baseline (unloaded capacitance) of each element by tare and drift tracking, and contact detection."""
