"""The physical foot, in numpy alone: response, gap contact, capacitors, calibrated parameters."""
