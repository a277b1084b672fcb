"""Gait estimation for a controller: contact and its times, load share, ground normal, friction, slip."""
