"""Evaluation of force estimators: error tables, the Cramer-Rao bound, other estimators for comparison."""
