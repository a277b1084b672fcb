"""Open CAN interfaces: a socket of Linux, or python-can's for a simulation on this computer.

address      which interface; its errors in words
opening      an address -> a `CanWire`
socket_wire  CAN of Linux
python_can   `udp_multicast`, and `virtual` within a process

Service and client share them; they need python-can, for a simulation alone.
"""
