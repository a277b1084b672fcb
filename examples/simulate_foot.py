"""Press a foot in simulation: the capacitance of its nine elements under forces of any direction, all at once."""

import argparse
import sys

try:
    import numpy as np

    from footsense import Foot
except ImportError as missing:
    sys.exit(f"{missing}: simulate_foot.py needs all of footsense; in its clone: pip install deploy/client .")

argparse.ArgumentParser(description=__doc__).parse_args()
foot = Foot("aoyagi-3x3")
forces_n = {
    "in the air": (0.0, 0.0, 0.0),
    "1 N along the leg": (0.0, 0.0, 1.0),
    "1 N, 20 degrees forward": (np.sin(np.radians(20)), 0.0, np.cos(np.radians(20))),
    "1 N, 20 degrees to the left": (0.0, np.sin(np.radians(20)), np.cos(np.radians(20))),
}
for name, force_n in forces_n.items():
    print(f"{name} [pF]; the first row is the most forward, the first column the leftmost")
    print(foot.capacitance_pf(force_n).reshape(3, 3).round(2))

# Arrays of forces of any leading shape: here 100 forces in each of 60 directions around the leg.
azimuth = np.linspace(0.0, 2 * np.pi, 60, endpoint=False)[:, None]
magnitude_n = np.linspace(0.01, 0.8, 100)
tilt = np.radians(20)
many_n = np.stack(
    np.broadcast_arrays(
        magnitude_n * np.sin(tilt) * np.cos(azimuth),
        magnitude_n * np.sin(tilt) * np.sin(azimuth),
        magnitude_n * np.cos(tilt),
    ),
    axis=-1,
)
capacitance_pf = foot.capacitance_pf(many_n)
most_pf = (capacitance_pf - foot.unloaded_pf).max()
print(
    f"forces of shape {many_n.shape} give {capacitance_pf.shape}; an element rises by at most {most_pf:.2f} pF"
)
