"""Feet in a batch, of whoever trains a controller: how many get their forces in a second; BLAS may use all cores."""

from typing import Literal

import numpy as np

from footsense.clock import stopwatch_ns
from footsense.sim import VirtualFeet

#: Feet at once, and step of a controller [s].
_N_FEET, _STEP_S, _N_STEPS = 4096, 0.02, 20


def measure_virtual_feet(board: Literal["ad7147", "fdc1004"], n_steps: int = _N_STEPS) -> dict[str, float]:
    """Return `batch`, `step_ms`, and `foot_steps_hz`: the steps of all feet in a second, half of them loaded."""
    feet = VirtualFeet(_N_FEET, board=board)
    normal = np.tile([0.0, 0.0, 1.0], (_N_FEET, 1))
    force_n = normal * np.resize([[1.0], [0.0]], (_N_FEET, 1))
    feet.step(0.0, force_n, normal)
    start_ns = stopwatch_ns()
    for step in range(n_steps):
        feet.step((step + 1) * _STEP_S, force_n, normal)
    foot_steps_hz = n_steps * _N_FEET / (1e-9 * (stopwatch_ns() - start_ns))
    return {"batch": _N_FEET, "step_ms": 1e3 * _STEP_S, "foot_steps_hz": round(foot_steps_hz)}
