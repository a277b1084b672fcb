"""The contact force of every foot of a legged robot, from soft capacitors to CAN.

The way of one frame is told, file by file, in `docs/architecture.md`.
"""

import os

# ONNX Runtime reads it when it is imported: else it starts a thread, which would inherit the loop's scheduling, and
# writes a device id and a database under ~/.cache.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

__version__ = "0.1.0"
