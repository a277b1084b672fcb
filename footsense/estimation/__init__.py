"""`CapFrame` to `ContactFrame`: capacitances to forces with sigma, state and contact, in plain numpy."""
