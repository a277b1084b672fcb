"""Studies of the error: bound, map, tolerance, sensors, hard cases."""
