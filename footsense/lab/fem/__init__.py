"""Finite element model of the elastic foot: one meshed quarter, solved per mirror symmetry with adjoint fields."""
