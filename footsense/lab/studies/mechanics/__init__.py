"""Studies of the foot as a solid and of its gaps."""
