"""Physical model of a foot, in numpy alone: response to loads, gap contact, capacitors, parameters."""
