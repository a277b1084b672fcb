"""Print the force on each foot of a running robot, seventy times a second, and whether it may be used.

In another terminal: footsense run --config deploy/simulated.yaml. Ends when the robot is silent for 2 s.
"""

import argparse
import signal
import sys

import footsense

for end in (signal.SIGPIPE, signal.SIGINT):  # `| head` and Ctrl-C end it without a word
    signal.signal(end, signal.SIG_DFL)

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--can", default="239.74.163.2", help="on a robot: can0")
try:
    feet = footsense.connect(parser.parse_args().can)
except footsense.FootsenseError as error:
    sys.exit(str(error))
with feet:
    for forces in feet:
        for leg, force in forces.items():
            if not force.usable:  # a fault, a tare, or too old: hold no force from before
                print(f"{leg}: no force: {force.state.name}, link {force.status.name}")
                continue
            # On the foot, in its frame: forward, left, along the leg to the body.
            fx_n, fy_n, fz_n = force.force_n
            what = "contact" if force.contact else "swing"
            print(
                f"{leg}: {fx_n:6.3f} {fy_n:6.3f} {fz_n:6.3f} N, z +- {force.sigma_n[2]:.3f} N, "
                f"{1000 * force.age_s:4.1f} ms old, {what}"
            )
