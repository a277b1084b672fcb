"""Fit a foot's calibration from recordings of the foot on a test stand.

`detection` and `reduction` make loads of presses, `guide` tells the user what to press next, `recorded_session` reads a
session, `calibrate` fits a model of the foot, `evaluation` compares the result with the reference, `writer` writes it.
"""
