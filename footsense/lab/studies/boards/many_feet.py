"""Many feet in one pipeline of the service: steps at all phases of a scan, missing elements, and gains that are off."""

from collections.abc import Sequence
from functools import partial
from itertools import product

import numpy as np

from footsense.benchmarks.conversions import FootLoad, PublishedForces
from footsense.benchmarks.latency_vs_error import PRESS_FORCES_N, STEP_NS, TrueLoads, settling_ms
from footsense.calibration.evaluation import DesignModels
from footsense.calibration.standing.calibrate import calibrate_standing
from footsense.calibration.standing.recording import StandingLoads
from footsense.daemon.setup.expected_error import uncertainty_of_uncalibrated
from footsense.estimation.network import Network
from footsense.foot.directions import normalized
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.parameters import FootParameters, ForceUncertainty
from footsense.foot.specimen import Specimen
from footsense.frames import ELEMENTS, IS_USABLE_STATE, LEGS, ROWS, GaitEventKind, Mask, Vector
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE
from footsense.lab.evaluation.walker_runs import (
    LEAD_IN_S,
    SCAN_TIMES,
    WalkerLoads,
    WalkerOutputs,
    WalkerReadings,
    judging_pipeline,
    read_walker,
    run_pipeline,
)
from footsense.lab.foot_file import FOOT_FILE
from footsense.lab.report import StudyContext, Values
from footsense.lab.studies.boards.force_figures import force_figures
from footsense.lab.training.load_cases import leaning_loads
from footsense.sim.fabrication import uncertainty_of_parameters
from footsense.sim.loads.ground_load import RampContact
from footsense.sim.loads.walk import Walk, measured_walk, smooth_stance_reaction

#: Keys of feet whose gains are off, uncalibrated and calibrated by standing, in `wrong_gain_figures`.
UNCALIBRATED, BY_STANDING = "1 %", "1 %, calibrated by standing"
#: Force of a step in the end [N], and phases of the scan at which it begins.
STEP_N, _N_PHASES = 1.0, 24
#: Time in the air from the tare to the first step, and time in which a step is looked at [s].
_BEFORE_STEP_S, _AFTER_STEP_S = 0.2, 0.3
#: Standard deviation of wrong gains [1], and draws of a foot's nine gains.
_GAIN_ERROR_REL, _N_DRAWS = 0.01, 20
#: Legs of the measured walk: one with the right foot's measured forces, one with the left's; end of the walk [s].
_SIDES, _WALK_S, _QUICK_WALK_S = ("rf", "lf"), 6.8, 2.2
#: Peak of the measured walk [N], and lean of its legs [deg].
_PEAK_N, _PITCH_DEG = 1.0, 10.0
#: Period in which loads are sampled [s].
_SAMPLING_S = 0.25e-3
#: Postures of a calibration by standing, sizes of their loads, lowest elevation [deg]; noise of a mean reading [pF].
N_POSTURES, POSTURE_GF, MIN_POSTURE_ELEVATION_DEG = 20, (20.0, 120.0), 70.0
_MEAN_READING_PF = 0.15e-3
#: Seed of the readings' noise.
_SEED = 990_002


def step_figures(context: StudyContext, board: str) -> Values:
    """Return the errors of the forces of feet from a step on, and when these have settled.

    Args:
        context: As of every study.
        board: A key of `SCAN_TIMES`.

    Returns:
        Those of `force_figures`; from the begin of a step to the sending of its touchdown `touchdown_p50_ms` and
        `touchdown_p99_ms`, infinite where none is told, and as of `settling_ms` `settled_p50_ms` and
        `settled_worst_ms`.
    """
    n_phases = 2 if context.quick else _N_PHASES
    scan_s, first_s = SCAN_TIMES[board].scan_s, LEAD_IN_S + _BEFORE_STEP_S
    starts_ns, feet = [], list[FootLoad]()
    for (x, y, z), phase in product(
        (STEP_N * normalized(np.array(PRESS_FORCES_N))).tolist(), range(n_phases)
    ):
        starts_ns.append(round(1e9 * (first_s + phase * scan_s / n_phases)))
        feet.append(partial(RampContact((x, y, z), starts_ns[-1], STEP_NS).contact, LEGS[0]))
    outputs = _run(context, board, _read(context, board, foot_loads(feet, first_s + scan_s + _AFTER_STEP_S)))
    sent_ns = np.rint(1e9 * outputs.t_s).astype(np.int64)
    # Without a force nothing has settled.
    told_n = np.where(IS_USABLE_STATE[outputs.state][..., None], outputs.force_n, 0.0)
    settled_ms = settling_ms(
        PublishedForces(sent_ns, sent_ns, told_n, outputs.sigma_n),
        TrueLoads.sample(feet, round(1e9 * first_s), int(sent_ns[-1])),
        starts_ns,
    )
    told_ms = np.full(len(feet), np.inf)
    for row, event in outputs.events:
        since_ms = 1e-6 * (sent_ns[row] - starts_ns[event.leg])
        if event.kind is GaitEventKind.TOUCHDOWN and since_ms > 0.0:
            told_ms[event.leg] = min(told_ms[event.leg], since_ms)
    return _figures(outputs, 0, len(feet)) | {
        "touchdown_p50_ms": np.percentile(told_ms, 50, method="nearest"),
        "touchdown_p99_ms": np.percentile(told_ms, 99, method="nearest"),
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
    readings = _read_walk(context, board, len(missing))
    nothing = np.repeat(missing, len(_SIDES), axis=0)[:, readings.elements].swapaxes(0, 1)
    capacitance_pf = np.where(nothing, 0.0, readings.capacitance_pf)
    outputs = _run(context, board, readings._replace(capacitance_pf=capacitance_pf))
    found, first = dict[str, Values](), 0
    for kind, masks in sets.items():
        found[kind] = _walk_figures(outputs, first, len(masks))
        first += len(masks)
    return found


def wrong_gain_figures(context: StudyContext, board: str) -> dict[str, Values]:
    """Return the errors in the measured walk of feet whose elements' closures are off by random gains.

    Args:
        context: As of every study.
        board: A key of `SCAN_TIMES`.

    Returns:
        By `UNCALIBRATED` and `BY_STANDING`, feet calibrated without a reference, `direction_deg` and `within_2_sigma`
        as of `force_figures`, lists over the draws.
    """
    n_draws = 2 if context.quick else _N_DRAWS
    normal = [np.random.default_rng(draw).normal(size=(len(_SIDES), ELEMENTS)) for draw in range(n_draws)]
    gain = 1.0 + _GAIN_ERROR_REL * np.concatenate(normal)
    readings, found = _with_gains(context, _read_walk(context, board, n_draws), gain), {}
    for name, own in ((UNCALIBRATED, None), (BY_STANDING, _calibrated_by_standing(context, gain))):
        outputs = _run(context, board, readings, own, _uncertainty(context, len(gain), own))
        draws = [_walk_figures(outputs, draw, 1) for draw in range(n_draws)]
        found[name] = {key: [draw[key] for draw in draws] for key in ("direction_deg", "within_2_sigma")}
    return found


def _calibrated_by_standing(context: StudyContext, gain: Vector) -> list[FootParameters]:
    """Return the parameters of feet with wrong gains [1], shape (feet, elements), that stood in the same postures."""
    models, design = (
        DesignModels.load(context.files(FOOT_FILE, RESPONSE_FILE, NETWORK_FILE)),
        context.response.design,
    )
    loads = leaning_loads(context.foot_design.loads, N_POSTURES, POSTURE_GF, MIN_POSTURE_ELEVATION_DEG, _SEED)
    unloaded_pf = np.full((len(loads.force_n), ELEMENTS), design.unloaded_pf)
    closure_um = design.closure_um(
        Specimen(context.response).capacitance_pf(loads.normal, loads.force_n), unloaded_pf
    )
    random, feet = np.random.default_rng(_SEED), []
    for of_foot in gain:
        off_pf = design.capacitance_pf(np.minimum(of_foot * closure_um, design.gap_um))
        read_pf = off_pf + _MEAN_READING_PF * random.normal(size=off_pf.shape)
        feet.append(calibrate_standing(models, StandingLoads(read_pf, unloaded_pf), None).parameters)
    return feet


def _with_gains(context: StudyContext, readings: WalkerReadings, gain: Vector) -> WalkerReadings:
    """Return readings as if each element's closure were multiplied by a gain [1], shape (feet, elements)."""
    design = context.response.design
    closure_um = design.closure_um(readings.capacitance_pf, np.array(design.unloaded_pf))
    off_um = gain[:, readings.elements].swapaxes(0, 1) * closure_um
    return readings._replace(capacitance_pf=design.capacitance_pf(np.minimum(off_um, design.gap_um)))


def _read_walk(context: StudyContext, board: str, n: int) -> WalkerReadings:
    """Return readings of n times the two feet of `_SIDES` in the measured walk."""
    walk = measured_walk(_PEAK_N, _PITCH_DEG, round(1e9 * LEAD_IN_S))
    feet = [partial(walk.contact, leg) for leg in _SIDES]
    loads = foot_loads(feet, _QUICK_WALK_S if context.quick else _WALK_S)
    force_n, normal = (np.tile(part, (1, n, 1)) for part in (loads.force_n, loads.normal))
    return _read(context, board, WalkerLoads.of_still_feet(loads.t_s, force_n, normal))


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


def _read(context: StudyContext, board: str, loads: WalkerLoads) -> WalkerReadings:
    return read_walker(Specimen(context.response), loads, _SEED, scan=SCAN_TIMES[board])


def _uncertainty(
    context: StudyContext, n_feet: int, own: list[FootParameters] | None
) -> list[ForceUncertainty]:
    """Return what the service does not know of feet that were made and not calibrated, or calibrated by standing."""
    if own is not None:
        return [uncertainty_of_parameters(foot, pressed=False) for foot in own]
    return [uncertainty_of_uncalibrated(_network(context, n_feet), context.response, n_feet)] * n_feet


def _network(context: StudyContext, n_feet: int) -> Network:
    return Network(context.files(NETWORK_FILE) / NETWORK_FILE, n_feet)


def _run(
    context: StudyContext,
    board: str,
    readings: WalkerReadings,
    own: list[FootParameters] | None = None,
    uncertainty: Sequence[ForceUncertainty] = (),
) -> WalkerOutputs:
    """Return what the service's pipeline says of readings of feet; of those as designed if `own` is None."""
    n_feet = readings.capacitance_pf.shape[1]
    pipeline = judging_pipeline(
        _network(context, n_feet),
        context.response,
        SCAN_TIMES[board],
        own or [None] * n_feet,
        uncertainty=uncertainty,
    )
    return run_pipeline(pipeline, readings)


def _walk_figures(outputs: WalkerOutputs, first: int, n: int) -> Values:
    """Return the errors of n times the two feet of `_SIDES`, from the `first` such pair on."""
    return _figures(outputs, len(_SIDES) * first, len(_SIDES) * n)


def _figures(outputs: WalkerOutputs, first: int, n: int) -> Values:
    """Return the errors of n feet, from the `first` on."""
    feet = slice(first, first + n)
    return force_figures(
        outputs.force_n[:, feet],
        outputs.sigma_n[:, feet],
        outputs.state[:, feet],
        outputs.true.force_n[:, feet],
    )
