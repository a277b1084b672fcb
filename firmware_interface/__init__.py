"""Interfaces of the hardware as bytes and numbers: registers, CAN frames, serial records, timings.

Standard library only, no I/O: the same facts serve the daemon, the simulator, the tests and firmware.
"""
