"""Simulator: feet, chips at byte level, buses in bit time, scenes. It imports no driver."""
