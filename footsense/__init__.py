"""Contact-force sensing for legged robots: from soft capacitive feet to forces on CAN.

The way of one frame is told, file by file, in `docs/architecture.md`.
"""

import os

# ONNX Runtime reads it when it is imported: else it starts a thread, which would inherit the loop's scheduling, and
# writes a device id and a database under ~/.cache.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

# OpenBLAS reads it when numpy is imported. Its threads wait for work by spinning, and the matrices here are small: on a
# busy machine the fit of a calibration took five times the processor time with two threads. One that is set wins.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"
