"""Solids of other sensors: the plain block of the paper's first model, and the soft film of its outlook."""
