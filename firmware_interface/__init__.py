"""Hardware interfaces as constants and codecs: chip registers, CAN frames, serial records, timing.

Standard library only, no I/O: the same facts serve the daemon, the simulator, the tests and firmware.
"""
