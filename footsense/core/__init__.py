"""What needs no hardware, file or clock: capacitances to forces, in plain numpy."""
