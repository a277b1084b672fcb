"""Inputs of a design: requirements (`wishes`), materials, converter boards and fabrication processes."""
