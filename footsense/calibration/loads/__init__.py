"""Presses of a foot found in a recording, each reduced to one calibration load."""
