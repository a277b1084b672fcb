"""Forces and gait semantics of some legs, to be changed in one way."""

from typing import Any

import numpy as np

from footsense.frames import BaselineDrift, ContactFrame, GaitFrame, Slip, State


def gait_frame(t_ns: int, n_legs: int = 1, **changed: Any) -> GaitFrame:
    """Return the gait of feet that stand on a slope; `changed` replaces values."""
    values = {
        "t_ns": t_ns,
        "contact": np.ones(n_legs, bool),
        "contact_raw": np.ones(n_legs, bool),
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


def contact_frame(
    t_sent_ns: int,
    n_legs: int = 1,
    *,
    sequence: int = 0,
    baseline: BaselineDrift | None = None,
    gait: GaitFrame | None = None,
    **changed: Any,
) -> ContactFrame:
    """Return valid legs without a force, read when it is sent; `changed` replaces values, of each leg or of all."""
    assert changed.keys() <= set(ContactFrame._fields)
    nan = np.full(n_legs, np.nan)
    values = {"state": State.VALID, "t_ns": t_sent_ns, "force_n": np.nan, "sigma_n": np.nan, **changed}
    values = {"contact_probability": np.nan, "holds": np.nan, **values}

    def codes(name: str, dtype: type = np.uint8) -> Any:
        return np.full(n_legs, values.get(name, 0), dtype)

    return ContactFrame(
        sequence=sequence,
        t_sent_ns=t_sent_ns,
        t_ns=codes("t_ns", np.int64),
        force_n=np.full((n_legs, 3), values["force_n"]),
        sigma_n=np.full((n_legs, 3), values["sigma_n"]),
        contact_probability=codes("contact_probability", np.float64),
        holds=codes("holds", np.float64),
        state=codes("state"),
        fault_mask=codes("fault_mask", np.uint16),
        flags=codes("flags"),
        cause=codes("cause"),
        noise_ff=codes("noise_ff", np.float64),
        baseline=baseline or BaselineDrift(codes("none"), nan, nan, codes("never", np.int64)),
        gait=gait,
    )
