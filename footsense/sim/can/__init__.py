"""A CAN interface, its queue and its controller, frame by frame in virtual time."""
