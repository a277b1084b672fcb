"""Studies of the force error: Cramer-Rao bound, error map, tolerances, number of elements, hard cases."""
