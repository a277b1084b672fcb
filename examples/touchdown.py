"""Print each touchdown of a running robot, and when it was relative to now, then how long each stance lasted.

In another terminal: footsense run --config deploy/simulated.yaml. Ends when the robot is silent for 2 s.
"""

import argparse
import signal
import sys
import time

import footsense

for end in (signal.SIGPIPE, signal.SIGINT):  # `| head` and Ctrl-C end it without a word
    signal.signal(end, signal.SIG_DFL)
touched_s: dict[str, float] = {}

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--can", default="239.74.163.2", help="on a robot: can0")
try:
    feet = footsense.connect(parser.parse_args().can)
except footsense.FootsenseError as error:
    sys.exit(str(error))
with feet:
    for forces in feet:
        for event in feet.events:  # those that came with these forces, each once
            if event.kind == "touchdown":
                touched_s[event.leg] = event.t_s
                ago_ms = 1000 * (time.monotonic() - event.t_s)
                # Little yet: the direction is not usable before half of the load.
                fz_n = forces[event.leg].force_n[2]
                sigma_ms = 1000 * event.sigma_s
                print(f"{event.leg}: touchdown {ago_ms:.0f} ms ago, +- {sigma_ms:.0f} ms; now {fz_n:.2f} N")
            elif event.kind == "lift_off" and event.leg in touched_s:
                print(f"{event.leg}: lift-off after {event.t_s - touched_s.pop(event.leg):.2f} s")
            elif event.kind == "slip":  # reported only where the robot's file has `contact.friction`
                print(f"{event.leg}: slips")
