"""Tare the feet of a running robot, which have to hang free and still: what they read now is then no force.

In another terminal: footsense run --config deploy/simulated.yaml --scene hanging.
"""

import sys

import footsense

# On a robot: footsense.connect("can0").
with footsense.connect(*sys.argv[1:2], interface="udp_multicast") as feet:
    for leg in feet.legs:  # or all at once: feet.tare()
        try:
            feet.tare(leg)
        except footsense.FootsenseError as refused:
            print(refused)
        else:
            print(f"{leg}: tared; reads {1000 * feet.latest()[leg].force_n[2]:.1f} mN now")
