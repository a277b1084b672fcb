"""Many feet in one pipeline of the service: steps at all phases of a scan, and missing elements."""

from collections.abc import Sequence
from functools import partial
from itertools import product

import numpy as np

from footsense.benchmarks.conversions import FootLoad, PublishedForces
from footsense.benchmarks.latency_vs_error import PRESS_FORCES_N, STEP_NS, TrueLoads, settling_ms
from footsense.estimation.network import Network
from footsense.foot.directions import normalized
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.specimen import Specimen
from footsense.frames import ELEMENTS, IS_USABLE_STATE, LEGS, ROWS, Mask
from footsense.lab.evaluation.walker_runs import (
    LEAD_IN_S,
    SCAN_TIMES,
    WalkerLoads,
    WalkerOutputs,
    judging_pipeline,
    read_walker,
    run_pipeline,
)
from footsense.lab.report import StudyContext, Values
from footsense.lab.studies.boards.force_figures import force_figures
from footsense.sim.loads.ground_load import RampContact
from footsense.sim.loads.walk import Walk, measured_walk, smooth_stance_reaction

#: Force of a step in the end [N], and phases of the scan at which it begins.
STEP_N, _N_PHASES = 1.0, 24
#: Time in the air from the tare to the first step, and time in which a step is looked at [s].
_BEFORE_STEP_S, _AFTER_STEP_S = 0.2, 0.3
#: Legs of the measured walk: one with the right foot's measured forces, one with the left's; end of the walk [s].
_SIDES, _WALK_S, _QUICK_WALK_S = ("rf", "lf"), 6.8, 2.2
#: Peak of the measured walk [N], and lean of its legs [deg].
_PEAK_N, _PITCH_DEG = 1.0, 10.0
#: Period in which loads are sampled [s].
_SAMPLING_S = 0.25e-3
#: Seed of the readings' noise.
_SEED = 990_002


def step_figures(context: StudyContext, board: str) -> Values:
    """Return the errors of the forces of feet from a step on, and when these have settled.

    Args:
        context: As of every study.
        board: A key of `SCAN_TIMES`.

    Returns:
        Those of `force_figures`, and as of `settling_ms` `settled_p50_ms` and `settled_worst_ms`.
    """
    n_phases = 2 if context.quick else _N_PHASES
    scan_s, first_s = SCAN_TIMES[board].scan_s, LEAD_IN_S + _BEFORE_STEP_S
    starts_ns, feet = [], list[FootLoad]()
    for (x, y, z), phase in product(
        (STEP_N * normalized(np.array(PRESS_FORCES_N))).tolist(), range(n_phases)
    ):
        starts_ns.append(round(1e9 * (first_s + phase * scan_s / n_phases)))
        feet.append(partial(RampContact((x, y, z), starts_ns[-1], STEP_NS).contact, LEGS[0]))
    outputs = _run(context, board, foot_loads(feet, first_s + scan_s + _AFTER_STEP_S))
    sent_ns = np.rint(1e9 * outputs.t_s).astype(np.int64)
    # Without a force nothing has settled.
    told_n = np.where(IS_USABLE_STATE[outputs.state][..., None], outputs.force_n, 0.0)
    settled_ms = settling_ms(
        PublishedForces(sent_ns, sent_ns, told_n, outputs.sigma_n),
        TrueLoads.sample(feet, round(1e9 * first_s), int(sent_ns[-1])),
        starts_ns,
    )
    return _figures(outputs, slice(None)) | {
        "settled_p50_ms": np.median(settled_ms),
        "settled_worst_ms": settled_ms.max(),
    }


def missing_figures(context: StudyContext, board: str) -> dict[str, Values]:
    """Return the errors in the measured walk with an element, a row or a column that reads nothing from the start.

    Args:
        context: As of every study.
        board: A key of `SCAN_TIMES`.

    Returns:
        By `element`, `row` and `column` those of `force_figures`, of all of them.
    """
    element = np.arange(ELEMENTS)
    sets: dict[str, list[Mask]] = {
        "element": [element == one for one in range(ELEMENTS)],
        "row": [element // ROWS == row for row in range(ROWS)],
        "column": [element % ROWS == column for column in range(ROWS)],
    }
    if context.quick:
        sets = {kind: masks[:1] for kind, masks in sets.items()}
    missing = np.array([mask for masks in sets.values() for mask in masks])
    walk = measured_walk(_PEAK_N, _PITCH_DEG, round(1e9 * LEAD_IN_S))
    pair = [partial(walk.contact, leg) for leg in _SIDES]
    loads = foot_loads(pair, _QUICK_WALK_S if context.quick else _WALK_S)
    force_n, normal = (np.tile(part, (1, len(missing), 1)) for part in (loads.force_n, loads.normal))
    feet_missing = np.repeat(missing, len(pair), axis=0)
    outputs = _run(context, board, WalkerLoads.of_still_feet(loads.t_s, force_n, normal), feet_missing)
    found, first = dict[str, Values](), 0
    for kind, masks in sets.items():
        last = first + len(pair) * len(masks)
        found[kind] = _figures(outputs, slice(first, last))
        first = last
    return found


def foot_loads(feet: Sequence[FootLoad], end_s: float) -> WalkerLoads:
    """Return the loads of feet up to a time [s]; they do not slide, and have no mass."""
    t_s = np.asarray(_SAMPLING_S * np.arange(round(end_s / _SAMPLING_S)), np.float64)
    contacts = [[foot(t_ns) for foot in feet] for t_ns in np.rint(1e9 * t_s).astype(int).tolist()]
    force_n, normal = (
        np.array([[getattr(contact, part) for contact in row] for row in contacts])
        for part in ("force_n", "normal")
    )
    return WalkerLoads.of_still_feet(t_s, force_n, normal)


def smooth_tripod(peak_n: float, start_ns: int) -> Walk:
    """Return a tripod with rounded stances of a peak [N], from a time on [ns]."""
    return Walk(
        dict.fromkeys(LEGS, smooth_stance_reaction(0.6, peak_n, 0.15)),
        period_ns=1_200_000_000,
        duty_rel=0.6,
        pitch_deg=10.0,
        from_ns=start_ns,
    )


def _run(context: StudyContext, board: str, loads: WalkerLoads, missing: Mask | None = None) -> WalkerOutputs:
    """Return what the service's pipeline says of feet as designed, of which elements may read nothing."""
    scan, n_feet = SCAN_TIMES[board], loads.force_n.shape[1]
    readings = read_walker(Specimen(context.response), loads, _SEED, scan=scan)
    if missing is not None:
        readings.capacitance_pf[missing[:, readings.elements].swapaxes(0, 1)] = 0.0
    network = Network(context.files(NETWORK_FILE) / NETWORK_FILE, n_feet)
    return run_pipeline(judging_pipeline(network, context.response, scan, [None] * n_feet), readings)


def _figures(outputs: WalkerOutputs, feet: slice) -> Values:
    """Return the errors of some of the feet."""
    return force_figures(
        outputs.force_n[:, feet],
        outputs.sigma_n[:, feet],
        outputs.state[:, feet],
        outputs.true.force_n[:, feet],
    )
