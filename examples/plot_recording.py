"""Draw the force along each leg in a recorded walk, with two sigma, touchdowns, and gaps where there is no force.

footsense run --duration 6 --record walk.mcap, pip install matplotlib,
then: python examples/plot_recording.py walk.mcap walk.png, or without names for these two.
"""

import argparse
import sys

import footsense

try:
    import matplotlib.pyplot as plt
except ImportError:
    sys.exit("plot_recording.py needs matplotlib: pip install matplotlib")

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("recording", nargs="?", default="walk.mcap")
parser.add_argument("picture", nargs="?", default="walk.png")
names = parser.parse_args()
try:
    walk = footsense.read(names.recording)
except footsense.FootsenseError as error:
    sys.exit(str(error))
figure, axes = plt.subplots(
    len(walk.legs), 1, sharex=True, sharey=True, squeeze=False, figsize=(10, 8), layout="constrained"
)
for number, (leg, axis) in enumerate(zip(walk.legs, axes[:, 0], strict=True)):
    fz_n, sigma_n = walk.force_n[:, number, 2], walk.sigma_n[:, number, 2]
    axis.fill_between(walk.t_s, fz_n - 2 * sigma_n, fz_n + 2 * sigma_n, alpha=0.3)
    axis.plot(walk.t_s, fz_n)
    for event in walk.events:
        if event.leg == leg and event.kind == "touchdown":
            axis.axvline(event.t_s, color="black", linewidth=0.8, linestyle=":")
    usable = walk.usable[:, number].mean()
    in_contact = walk.contact[:, number].mean()
    axis.set_ylabel(f"{leg}, fz [N]")
    print(f"{leg}: usable {usable:.0%} of the time, in contact {in_contact:.0%}")
axes[0, 0].set_title("force along the leg, two sigma, and touchdowns (dotted)")
axes[-1, 0].set_xlabel("time [s]")
try:
    figure.savefig(names.picture)
except (OSError, ValueError) as error:
    sys.exit(f"{names.picture}: {error}")
print(names.picture)
