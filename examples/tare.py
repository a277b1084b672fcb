"""Tare the feet of a running robot, which have to hang free and still: what they read now is then no force.

In another terminal: footsense run --config deploy/simulated.yaml --scene hanging.
"""

import sys

import footsense

# On a robot: footsense.connect("can0").
with footsense.connect(*sys.argv[1:2], interface="udp_multicast") as feet:
    for leg in feet.legs:  # or all at once: feet.tare()
        before_n = feet.latest()[leg].force_n[2]
        try:
            feet.tare(leg)
        except footsense.FootsenseError as refused:
            print(refused)
        else:
            now_n = feet.latest()[leg].force_n[2]
            print(f"{leg}: tared; read {1000 * before_n:.1f} mN before, {1000 * now_n:.1f} mN now")
