"""Gait semantics of some legs."""

from typing import Any

import numpy as np

from footsense.frames import GaitFrame, Slip


def gait_frame(t_ns: int, n_legs: int = 1, **changed: Any) -> GaitFrame:
    """Return the gait of feet that stand on a slope; `changed` replaces values."""
    values = {
        "t_ns": t_ns,
        "contact": np.ones(n_legs, bool),
        "contact_raw": np.ones(n_legs, bool),
        "probability": np.full(n_legs, 0.995),
        "touchdown_ns": np.full(n_legs, 7_000_000, np.int64),
        "touchdown_sigma_s": np.full(n_legs, 0.002),
        "lift_off_ns": np.zeros(n_legs, np.int64),
        "lift_off_sigma_s": np.full(n_legs, np.nan),
        "load_share": np.full(n_legs, 1.0 / n_legs),
        "normal": np.tile([0.28, 0.0, 0.96], (n_legs, 1)),
        "normal_sigma_rad": np.full(n_legs, 0.05),
        "tangential_over_normal": np.full(n_legs, 0.2),
        "tangential_over_normal_sigma": np.full(n_legs, 0.012),
        "slip": np.full(n_legs, Slip.NONE, np.uint8),
        "friction": 0.6,
        "all_in_air": False,
        "events": (),
    }
    return GaitFrame(**(values | changed))  # type: ignore[arg-type]
