"""Tare the feet of a running robot, which have to hang free and still: what they read now is then no force.

In another terminal: footsense run --config deploy/simulated.yaml --scene hanging.
"""

import argparse
import sys

import footsense

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--can", default="239.74.163.2", help="on a robot: can0")
try:
    feet = footsense.connect(parser.parse_args().can)
except footsense.FootsenseError as error:
    sys.exit(str(error))
refusals = 0
with feet:
    for leg in feet.legs:  # or all at once: feet.tare()
        # What a gait controller knows: the foot is still, the leg upright. In a walk it says so in each of its steps.
        up, phase = (0.0, 0.0, 1.0), footsense.StepPhase.SWING
        feet.send_motion(leg, acceleration_m_per_s2=0.0, sigma_m_per_s2=0.1, up=up, phase=phase)
        try:
            feet.tare(leg)
        except footsense.FootsenseError as refused:
            refusals += 1
            print(refused)
        else:
            force = feet.latest()[leg]
            reads = f"reads {1000 * force.force_n[2]:.1f} mN now" if force.usable else "no force yet"
            print(f"{leg}: tared; {reads}")
sys.exit(1 if refusals else 0)
