"""Calibration without a reference sensor: the electrodes of feet, from loads at rest of a robot that stands."""
