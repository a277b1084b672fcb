"""Fit the parameters of a foot to calibration loads, and predict the remaining force errors."""
