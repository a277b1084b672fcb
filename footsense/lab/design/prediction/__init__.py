"""Prediction of a foot's response without solving it: a few solved `shapes`, scaled and interpolated."""
