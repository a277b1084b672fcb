"""Inputs of a design: requirements (`requirements`), materials, converter boards and fabrication processes."""
