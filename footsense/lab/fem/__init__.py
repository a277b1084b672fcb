"""Finite elements of the elastic foot: one meshed quarter, solved per mirror symmetry by adjoint fields."""
