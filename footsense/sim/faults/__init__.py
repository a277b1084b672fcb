"""Faults of a scene, and their simulation in wires, chips, feet and lines."""
