"""Readings of feet that touch down, conversion by conversion."""

import numpy as np

from footsense.acquisition.scan_plan import ORDERS
from footsense.benchmarks.latency_vs_error.chain import converted_pf
from footsense.benchmarks.touchdown.touchdowns import Steps
from footsense.foot.gap_contact import capacitance_pf
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS, Stamps, Vector

#: Conversions per second, and elements in the order of the scan.
RATE_SPS = 400
ORDER = ORDERS["lo_shu"]
#: 20 K in ten minutes at 1.5 fF/K, and the difference between elements in that [pF/s, 1].
_DRIFT_PF_PER_S, _DRIFT_SPREAD_REL = -1.5e-3 * 20 / 600, 0.2
#: Force at which the response is linearised [N].
_PROBE_N = 1e-3


def readings_pf(foot: Foot, steps: Steps, t_ns: Stamps, rng: np.random.Generator) -> Vector:
    """Return the reading of each conversion [pF], shape (conversions, feet), with drift, tremor, noise and step."""
    design = foot.response.design
    t_s = t_ns / 1e9
    n_feet, element = len(steps.kind), np.resize(ORDER, len(t_ns))
    spread = 1.0 + _DRIFT_SPREAD_REL * rng.standard_normal((n_feet, ELEMENTS))
    drift_pf_per_s = _DRIFT_PF_PER_S * spread
    # No gap closes, so that closures are proportional to the force.
    normals = steps.normals.reshape(-1, 3)
    cells_um = foot.cells_um(normals, normals * _PROBE_N).reshape(*steps.normals.shape[:2], -1)
    cells_um_per_n = cells_um / _PROBE_N
    up_n = np.array([[0.0, 0.0, _PROBE_N]])
    pf_per_n = (foot.capacitance_pf(up_n / _PROBE_N, up_n)[0] - foot.unloaded_pf) / _PROBE_N
    force_n, step = steps.force_n(t_s), steps.step(t_s)
    all_pf = foot.unloaded_pf[element][:, None].repeat(n_feet, axis=1)
    for loaded in np.array_split(np.argwhere(force_n), 64):  # in parts, for the memory of all cells
        at, feet = loaded.T
        closure_um = cells_um_per_n[feet, step[at, feet]] * force_n[at, feet][:, None]
        distance_um = design.gap_um - closure_um + design.film_equivalent_um
        all_pf[at, feet] = capacitance_pf(design, distance_um)[np.arange(len(at)), element[at]]
    all_pf += drift_pf_per_s.T[element] * t_s[:, None] + steps.tremor_n(t_s) * pf_per_n[element][:, None]
    return converted_pf(all_pf, RATE_SPS, rng)
