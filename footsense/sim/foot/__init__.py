"""Simulated deviations of a foot from its elastic design: rubber, temperature, fabrication."""
