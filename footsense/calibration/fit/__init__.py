"""From calibration loads to the parameters of a foot, and the force errors that remain."""
