"""Simulated walks with one fault each: its report on CAN, the recovery, and the effect on the other legs."""
