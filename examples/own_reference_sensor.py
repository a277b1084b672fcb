"""A force sensor that footsense has no driver for calibrates a foot: this program reads it, and footsense this program.

    python examples/own_reference_sensor.py stand.yaml        # leave it running; in another terminal:
    footsense test-stand record --reference stand.yaml --foot foot-0007 session.mcap

`footsense test-stand record` reads lines of text from any serial port, and a pseudo-terminal is one. Put the calls of
your sensor's library into `read_sensor`, and its units, range and axes into STAND.

The force that `read_sensor` returns here is invented, and is not that of a simulated foot's presses: some are refused,
and the recording ends with "do not calibrate with it", as it should where a sensor measures another force.
"""

import argparse
import math
import os
import sys
import time
import tty
from pathlib import Path

RATE_HZ = 200.0
STAND = """# written by own_reference_sensor.py; all keys: deploy/test-stand.yaml
sensor: {{kind: serial, device: {port}, rate_hz: {rate_hz}, columns: [time_us, fx, fy, fz]}}
units: N
rated: [10, 10, 20]           # ends of the range of the sensor's own x, y and z
axes: {{x: -x, y: -y, z: -z}}   # the sensor stands under the foot, and measures what the foot does to it
"""


def read_sensor(t_s: float) -> tuple[float, float, float]:
    """Return the force on the sensor [N], in its own axes. Here: a press of 1 N every four seconds."""
    return 0.0, 0.0, -(max(0.0, math.sin(0.5 * math.pi * t_s)) ** 0.2)


def main() -> None:
    """Write the file of the test stand, then send a line for each sample until Ctrl-C."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("stand", type=Path, help="file of the test stand to write")
    stand = parser.parse_args().stand
    controller, terminal = os.openpty()  # this program's end, and the one that footsense opens as a port
    tty.setraw(terminal)
    os.set_blocking(controller, False)
    try:
        with stand.open("x", encoding="utf-8") as file:
            file.write(STAND.format(port=os.ttyname(terminal), rate_hz=RATE_HZ))
    except FileExistsError:
        sys.exit(f"{stand}: exists and is not overwritten; choose another name or remove it")
    print(f"{stand}: the sensor is {os.ttyname(terminal)}", flush=True)
    start_s = time.monotonic()
    for number in range(sys.maxsize):
        time.sleep(max(0.0, start_s + number / RATE_HZ - time.monotonic()))
        t_s = time.monotonic() - start_s
        fx, fy, fz = read_sensor(t_s)
        try:
            os.write(controller, f"{1e6 * t_s:.0f},{fx:.4f},{fy:.4f},{fz:.4f}\n".encode())
        except BlockingIOError:
            tty.setraw(terminal)  # nobody reads yet: what waits is old, and dropped


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        print("ended")
