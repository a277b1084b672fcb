"""Studies of the foot's elastic solid and of the capacitor gaps."""
