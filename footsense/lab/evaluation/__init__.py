"""Evaluation of force estimators: error tables, Cramer-Rao bound, and reference estimators."""
