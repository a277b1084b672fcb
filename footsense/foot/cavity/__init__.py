"""Cavities between a foot's electrodes: pressure and leakage of the air, fringe field."""
