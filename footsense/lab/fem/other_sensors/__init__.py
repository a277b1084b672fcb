"""Finite element models of other sensors: the plain block of the paper, and the gel film of its outlook."""
