"""Electrodes of feet found while the robot walks: its stances, their recursive fit, and its worth."""
