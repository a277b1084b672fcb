"""Studies of the foot's finite element model and of the capacitor gaps."""
