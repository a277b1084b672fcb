"""A simulated test stand: calibration loads and the force sensor under them."""
