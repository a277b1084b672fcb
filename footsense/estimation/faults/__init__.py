"""Fault detection of elements and legs: status, residual test, imputation."""
