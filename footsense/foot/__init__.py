"""The physical foot, in numpy alone: response, contact of its gaps, capacitors, and what calibration found of it."""
