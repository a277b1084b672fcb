"""Estimate forces from capacitances: `CapFrame` to `ContactFrame` with sigma, state and contact, in plain numpy."""
