"""Find the presses in a recording, and reduce each to one calibration load."""
