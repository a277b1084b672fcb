"""Couplings between the lines of a foot, computed from its drawn flexes."""
