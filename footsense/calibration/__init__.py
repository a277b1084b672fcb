"""Fit a foot's calibration from recordings of the foot on a test stand.

`loads` finds the presses, `session` guides and reads a session, `fit` fits a model of the foot, `evaluation`
compares the result with the reference, `writer` writes the files.
"""
