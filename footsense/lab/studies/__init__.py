"""Studies of the report: each answers one question about the sensor, with a table and a figure."""
