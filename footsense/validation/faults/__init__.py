"""One walk with each fault: appearance on CAN, recovery, and effect on the other legs."""
