"""Estimate forces from arrays of capacitances, as the service does it, and compare them with the true ones."""

import argparse
import sys

try:
    import numpy as np

    from footsense import Estimator, Foot
except ImportError as missing:
    sys.exit(
        f"{missing}: estimate_array.py needs all of footsense; in its clone: pip install deploy/client ."
    )

argparse.ArgumentParser(description=__doc__).parse_args()
# Readings of a foot that is rolled under 0.7 N, every 22 ms: of your own bench, or here of the simulated foot.
rng = np.random.default_rng(1)
t_s = 0.022 * np.arange(400)
tilt = np.radians(20) * np.sin(2 * np.pi * 0.5 * t_s)
true_n = 0.7 * np.stack([np.sin(tilt), np.zeros_like(tilt), np.cos(tilt)], axis=1)
foot = Foot("aoyagi-3x3")
capacitance_pf = foot.capacitance_pf(true_n) + 0.002 * rng.standard_normal((400, 9))

# What each element reads while the foot hangs free; without it the first scans have to be of the free foot. Nobody has
# calibrated this one: its sigma has the tolerances of manufacture, and the simulated foot is as designed.
estimator = Estimator("aoyagi-3x3", unloaded_pf=foot.unloaded_pf)
forces = estimator.run(capacitance_pf, t_s)
error_n = forces.force_n - true_n
print(f"usable: {forces.usable.mean():.0%} of {len(t_s)} rows, in contact: {forces.contact.mean():.0%}")
for axis, error, sigma in zip("xyz", error_n.T, forces.sigma_n.T, strict=True):
    rms_mn = 1000 * np.sqrt(np.nanmean(error**2))
    print(f"f{axis}: wrong by {rms_mn:.1f} mN rms; sigma as of a made foot {1000 * np.nanmean(sigma):.1f} mN")

# A recorded walk, whose elements were read one after the other, also needs the times of the readings:
# walk = footsense.read("walk.mcap")
# forces = estimator.run(walk.capacitance_pf, walk.t_s, walk.reading_t_s)
