"""From the recordings of a foot on a bench to the calibration that it ships with.

CalibrationLoads are found in a recording, a model of the foot is fitted to them, and what the model leaves is learnt by a small
correction. Runs with numpy alone, so a foot can be calibrated where it is used.
"""
