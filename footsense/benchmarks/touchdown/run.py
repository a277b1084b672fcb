"""Simulate feet that touch down: their readings per conversion, and the daemon's frames estimated from them.

The pace is that of the study `tradeoff`.
"""

from dataclasses import dataclass

import numpy as np

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.benchmarks.latency_vs_error.chain import (
    conversion_timing,
    latest_conversion_indices,
    quantized_capacitance_pf,
)
from footsense.benchmarks.touchdown.touchdowns import CONTACT_THRESHOLD_N, RandomTouchdowns
from footsense.estimation.pipeline import Pipeline
from footsense.estimation.sensitivity import sensitivity
from footsense.estimation.settings import EstimationLimits, MountedFeet, TareLimits
from footsense.foot.gap_contact import capacitance_pf
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS, CapFrame, Flag, Mask, Reading, Stamps, Vector
from footsense.lab.former_page import StudyContext

#: Conversions per second, and elements in the order of the scan.
RATE_SPS = 400
SCAN_ORDER = CONVERSION_ORDERS["lo_shu"]
#: 20 K in ten minutes at 1.5 fF/K, and the difference between elements in that [pF/s, 1].
_DRIFT_PF_PER_S, _DRIFT_SPREAD_REL = -1.5e-3 * 20 / 600, 0.2
#: Force at which the response is linearised [N].
_SENSITIVITY_PROBE_N = 1e-3


def readings_pf(foot: Foot, steps: RandomTouchdowns, t_ns: Stamps, rng: np.random.Generator) -> Vector:
    """Return the reading of each conversion [pF], shape (conversions, feet), with drift, tremor and noise."""
    design = foot.response.design
    t_s = t_ns / 1e9
    n_feet, element = len(steps.kind), np.resize(SCAN_ORDER, len(t_ns))
    spread = 1.0 + _DRIFT_SPREAD_REL * rng.standard_normal((n_feet, ELEMENTS))
    drift_pf_per_s = _DRIFT_PF_PER_S * spread
    # No gap closes, so that closures are proportional to the force.
    normals = steps.normals.reshape(-1, 3)
    cell_closures_um = foot.cell_closures_um(normals, normals * _SENSITIVITY_PROBE_N).reshape(
        *steps.normals.shape[:2], -1
    )
    cells_um_per_n = cell_closures_um / _SENSITIVITY_PROBE_N
    up_n = np.array([[0.0, 0.0, _SENSITIVITY_PROBE_N]])
    pf_per_n = (
        foot.capacitance_pf(up_n / _SENSITIVITY_PROBE_N, up_n)[0] - foot.unloaded_pf
    ) / _SENSITIVITY_PROBE_N
    force_n, step = steps.normal_force_n(t_s), steps.latest_touchdown_index(t_s)
    all_pf = foot.unloaded_pf[element][:, None].repeat(n_feet, axis=1)
    for loaded in np.array_split(np.argwhere(force_n), 64):  # in parts, for the memory of all cells
        at, feet = loaded.T
        closure_um = cells_um_per_n[feet, step[at, feet]] * force_n[at, feet][:, None]
        distance_um = design.gap_um - closure_um + design.film_equivalent_um
        all_pf[at, feet] = capacitance_pf(design, distance_um)[np.arange(len(at)), element[at]]
    all_pf += (
        drift_pf_per_s.T[element] * t_s[:, None]
        + steps.vibration_after_neighbour_n(t_s) * pf_per_n[element][:, None]
    )
    return quantized_capacitance_pf(all_pf, RATE_SPS, rng)


@dataclass(frozen=True, slots=True, eq=False)
class PublishedRun:
    """Estimated and true forces and contacts of a run, shape (frames, feet), and the sending times.

    Attributes:
        sent_s: Time of sending [s], shape (frames,).
        contact: Flag CONTACT.
        axial_force_n: Force along the leg [N], NaN without one.
        true_axial_force_n: True force along the leg at the time of sending [N].
        is_swing: Whether the foot was in swing.
    """

    sent_s: Vector
    contact: Mask
    axial_force_n: Vector
    true_axial_force_n: Vector
    is_swing: Mask


def simulate_touchdowns(
    context: StudyContext, steps: RandomTouchdowns, until_s: float, seed: int
) -> PublishedRun:
    """Return the daemon's frames for feet that touch down repeatedly, one frame per conversion.

    Args:
        context: Response table and network.
        steps: Steps of the feet.
        until_s: End of the run [s].
        seed: Seed of noise and drift.
    """
    step_ns, lead_ns = conversion_timing(RATE_SPS)
    n_feet, n = len(steps.kind), int(until_s * 1e9) // step_ns
    t_ns = np.arange(1, n + 1, dtype=np.int64) * step_ns
    read_pf = readings_pf(Foot(context.response, contact=False), steps, t_ns, np.random.default_rng(seed))
    pipeline = _pipeline(context, n_feet)
    numbers = latest_conversion_indices(SCAN_ORDER, n)
    sent_ns = (t_ns + lead_ns)[ELEMENTS - 1 :]
    ok = np.full((n_feet, ELEMENTS), Reading.OK, np.uint8)
    contact, force_n = [], []
    for sequence, (number, now_ns) in enumerate(zip(numbers, sent_ns.tolist(), strict=True)):
        frame = CapFrame(sequence, np.tile(t_ns[number], (n_feet, 1)), read_pf[number].T.copy(), ok)
        forces, _ = pipeline.process(frame, now_ns)
        contact.append(forces.flags & Flag.CONTACT > 0)
        force_n.append(forces.force_n[:, 2])
    sent_s = sent_ns / 1e9
    true_force_n = steps.normal_force_n(sent_s) * steps.upright
    return PublishedRun(sent_s, np.array(contact), np.array(force_n), true_force_n, steps.is_swing(sent_s))


def _pipeline(context: StudyContext, n_feet: int) -> Pipeline:
    """Return the daemon's pipeline with one leg per simulated foot."""
    network, trained = context.network, context.trained_inputs
    scan_ns = ELEMENTS * conversion_timing(RATE_SPS).step_ns
    return Pipeline(
        network,
        trained,
        MountedFeet.as_designed(trained.design, n_feet),
        EstimationLimits(
            tare=TareLimits(window_scans=8, noise_limit_ff=5.0, unloaded_limit_rel=0.03),
            least_contact_n=CONTACT_THRESHOLD_N,
            scan_ns=scan_ns,
            max_age_ns=4 * scan_ns,
        ),
        sensitivity(network, 1, trained.moments),
    )
