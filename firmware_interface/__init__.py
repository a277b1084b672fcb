"""What the wires mean: registers, CAN frames and timings as bytes and numbers.

Standard library only, no I/O: the same facts serve the daemon, the simulator, the tests and firmware.
"""
