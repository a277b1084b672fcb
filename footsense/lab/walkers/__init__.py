"""Walking robots of a physics engine, whose feet are ours: loads to train, select and judge by."""
