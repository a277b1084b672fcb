"""Errors of the forces of some feet against the true ones, in the words of the pages."""

import numpy as np

from footsense.foot.directions import angles_between_deg
from footsense.frames import IS_USABLE_STATE, Codes, Vector
from footsense.lab.report import Values

#: Least true force whose error counts, on a foot with a load of 1 N [N].
LOADED_N = 0.1


def force_figures(
    force_n: Vector, sigma_n: Vector, state: Codes, true_n: Vector, loaded_n: float = LOADED_N
) -> Values:
    """Return the errors of the usable forces of loaded feet; NaN if there is none.

    Args:
        force_n: Forces [N], shape (..., 3).
        sigma_n: Their standard deviations [N], same shape.
        state: State of the leg with each, shape (...).
        true_n: True forces at the time of sending [N], shape (..., 3).
        loaded_n: Least true force that counts [N].

    Returns:
        `direction_deg`, mean, and `direction_p95_deg`; `magnitude_rel`, mean; `within_2_sigma`, share of the components
        of the errors; `no_force_share`, of the loaded time.
    """
    loaded = np.linalg.norm(true_n, axis=-1) > loaded_n
    counted = loaded & IS_USABLE_STATE[state]
    found_n, true_n = force_n[counted], true_n[counted]
    if not len(found_n):
        nothing = dict.fromkeys(
            ("direction_deg", "direction_p95_deg", "magnitude_rel", "within_2_sigma"), float("nan")
        )
        return nothing | {"no_force_share": 1.0}
    deg = angles_between_deg(found_n, true_n)
    size_rel = np.linalg.norm(found_n, axis=1) / np.linalg.norm(true_n, axis=1)
    return {
        "direction_deg": deg.mean(),
        "direction_p95_deg": np.percentile(deg, 95),
        "magnitude_rel": np.abs(size_rel - 1.0).mean(),
        "within_2_sigma": (np.abs(found_n - true_n) < 2.0 * sigma_n[counted]).mean(),
        "no_force_share": 1.0 - len(found_n) / loaded.sum(),
    }
