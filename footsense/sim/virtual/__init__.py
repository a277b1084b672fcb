"""Thousands of feet at once, in arrays of the caller: numpy, JAX or torch."""
