"""The contact force of every foot of a legged robot, from soft capacitors to CAN.

The way of one frame is told, file by file, in `docs/architecture.md`.
"""

__version__ = "0.1.0"
