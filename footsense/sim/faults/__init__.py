"""Faults that a scene can inject, and their simulation in bus wires, chips and feet."""
