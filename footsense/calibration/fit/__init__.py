"""From calibration loads to the parameters of a foot, and how uncertain they leave its force."""
