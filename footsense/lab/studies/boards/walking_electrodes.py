"""Electrodes that a robot finds while it walks: errors of the forces before and after, on feet of board `ad7147`.

Each foot is made with the paper's tolerances, with creeping rubber. Readings are those of the logs of walking robots,
one after the other and again; the service's pipeline says when the foot is in the air. Directions are judged in the
foot's own frame: no walk tells the mount.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.selfcal.instants import LegScans
from footsense.calibration.selfcal.state import FootIdentity
from footsense.calibration.selfcal.walking_foot import WalkingFoot
from footsense.calibration.twin import GAIN, STRAY
from footsense.daemon.setup.expected_error import ExpectedError
from footsense.foot.directions import angles_between_deg
from footsense.foot.parameters import FootParameters
from footsense.foot.specimen import Specimen
from footsense.foot.type_folders import released_folder
from footsense.frames import ELEMENTS, IS_USABLE_STATE, Vector
from footsense.lab.evaluation.off_table import OffTableFoot
from footsense.lab.evaluation.walker_runs import (
    SCAN_TIMES,
    WalkerLoads,
    WalkerReadings,
    judging_pipeline,
    read_walker,
    run_pipeline,
    walker_loads,
)
from footsense.lab.parallel import compute_each
from footsense.lab.report import Values, table
from footsense.lab.walkers.simulate import WalkerLog
from footsense.lab.walkers.split import NEW_JUDGEMENT
from footsense.sim.fabrication import PAPER_TOLERANCES, draw_deviations
from footsense.sim.rubber import draw_floor_pf
from footsense.sim.uncalibrated import uncertainty_by_wear, uncertainty_of_uncalibrated

_BOARD, _SEED = "ad7147", 0
_SCAN = SCAN_TIMES[_BOARD]
#: Radius of the ball [mm]; the pull of its mass is left out here.
_BALL_RADIUS_MM = 10.0
#: Gain in direction that is worth a calibration [deg].
WORTH_DEG = 0.3
#: Standard deviation of gains that have drifted [1].
DRIFT_REL = 0.04
#: Scans that a foot gets at once, as of the second between two looks at a service's ring.
_SCANS_AT_ONCE = 145
#: Time constant of elements that creep [s].
_CREEP_S = 0.3
#: Times of walking at which errors are computed [s], gaits that it is of, and the foot type, on its own robot.
_MARKS_S, _GAITS, _FOOT_TYPE = (10.0, 30.0, 60.0), ("pairs", "amble", "front-wave"), "hexapod-2kg"
#: Loads of a walk by which a foot is judged, their least size over the 98th percentile [1]; draws of its electrodes.
_N_LOADS, _MIN_SIZE_REL, _DRAWS = 150, 0.2, 16


def walked_foot_figures(
    models: DesignModels,
    logs: Sequence[WalkerLog],
    number: int,
    *,
    known: Literal["design", "drifted", "right"] = "design",
    creep_rel: float = 0.0,
    floor_pf: float = 0.0,
    stiffness_rel: float | None = None,
    off_table_rel: float = 0.0,
    cut_s: float = np.inf,
) -> Values:
    """Return the errors of one foot before and while it finds its electrodes.

    Args:
        models: Models of its type.
        logs: What the feet of a robot felt; the foot is on the leg of its number.
        number: Number of the foot.
        known: What the service knows of it: the design and its unloaded readings, a calibration whose gains have
            drifted by `DRIFT_REL`, or one that is right.
        creep_rel: Standard deviation of the creep of its elements, over their closure [1].
        floor_pf: Largest capacitance that the floor adds to the elements of a foot in contact [pF].
        stiffness_rel: Stiffness of the foot over the designed one, minus one [1]; None to draw it.
        off_table_rel: Error of the response table for this foot, rms over the loads [1].
        cut_s: Time from which the line of its middle element is cut [s].

    Returns:
        `before_deg`; by time `after_deg`, `within_2_sigma`, share of the components, by the network's sigma and what is
        not known of the electrodes, and `turned_sigma_deg`; in the end `objection`, empty if they are proposed.
    """
    own = draw_deviations(models.response, PAPER_TOLERANCES, _SEED, number)
    if stiffness_rel is not None:
        own = replace(own, stiffness_rel=stiffness_rel)
    foot = OffTableFoot(models.response, own, error_rel=off_table_rel)
    random = np.random.default_rng(number)
    gain_rel = 1.0 + DRIFT_REL * random.normal(size=ELEMENTS) if known == "drifted" else np.ones(ELEMENTS)
    parameters = _as_designed(foot)
    if known != "design":
        parameters = FootParameters(
            stray_pf=np.asarray(own.stray_pf),
            unloaded_pf=foot.unloaded_pf,
            gap_um=foot.gap_um,
            gain_rel=gain_rel,
        )
    loads = _loads(logs, number, _MARKS_S[-1])
    readings = read_walker(foot, loads, number, scan=_SCAN, viscous_rel=1.0)
    is_cut = (readings.t_s > cut_s) & (readings.elements == ELEMENTS // 2)
    readings.capacitance_pf[:, 0][is_cut] = foot.stray_pf[ELEMENTS // 2]
    scans = _scans(models, readings, parameters)
    scans = scans._replace(capacitance_pf=_worn_pf(models, foot, scans, creep_rel, floor_pf, random))
    walking, first = _walking(models, parameters, calibration="" if known == "design" else "0" * 64), 0
    normal, true_n = _judging_loads(loads, random)
    read_pf = foot.capacitance_pf(normal, true_n)
    usable = read_pf.max(axis=1) < _SCAN.range_end_pf
    read_pf, true_n = read_pf[usable], true_n[usable] @ own.mount.T / (1.0 + own.stiffness_rel)

    def forces(stray_pf: Vector, gain_rel: Vector) -> tuple[Vector, Vector]:
        load = models.estimate_in_foot_frame(read_pf, foot.unloaded_pf, stray_pf, gain_rel)
        return load.force_n, load.sigma_n

    before_n, _ = forces(parameters.stray_pf, parameters.gain_rel)
    figures: Values = {"before_deg": float(angles_between_deg(before_n, true_n).mean())}
    times_s = 1e-9 * scans.t_ns.max(axis=1)
    for mark_s in _MARKS_S:
        end = int(np.searchsorted(times_s, times_s[0] + mark_s))
        for begin in range(first, end, _SCANS_AT_ONCE):
            walking.add(scans.subset(slice(begin, min(begin + _SCANS_AT_ONCE, end))))
        walking.judge()
        first, found = end, walking.electrodes
        drawn = random.multivariate_normal(
            found.parameters[: len(found.own_covariance)], found.own_covariance, _DRAWS, method="cholesky"
        )
        force_n, sigma_n = forces(found.parameters[STRAY], 1.0 + found.parameters[GAIN])
        spread_n = np.std([forces(one[STRAY], 1.0 + one[GAIN])[0] for one in drawn], axis=0)
        figures[f"{mark_s:g} s"] = {
            "after_deg": float(angles_between_deg(force_n, true_n).mean()),
            "within_2_sigma": float((np.abs(force_n - true_n) < 2.0 * np.hypot(sigma_n, spread_n)).mean()),
            "turned_sigma_deg": walking.turn and walking.turn.sigma_deg,
        }
    return figures | {"objection": walking.objection}


def _as_designed(foot: Specimen) -> FootParameters:
    """Return what the service knows of a foot that nobody calibrated: the design, and its unloaded readings."""
    gap_um = np.full(ELEMENTS, foot.response.design.gap_um)
    return FootParameters(stray_pf=np.zeros(ELEMENTS), unloaded_pf=foot.unloaded_pf, gap_um=gap_um)


def _walking(models: DesignModels, known: FootParameters, calibration: str = "") -> WalkingFoot:
    """Return a foot that is not calibrated, or whose calibration is of a hash, and days old."""
    network, response = models.network_for_rows(1), models.response
    of = FootIdentity(
        leg="lf", foot="", foot_type=response.foot_type, board=_BOARD, calibration=calibration, since=""
    )
    unknown = (uncertainty_by_wear if calibration else uncertainty_of_uncalibrated)(network, response, 1)
    return WalkingFoot(models, of, known, ExpectedError.of(unknown).direction_deg)


def walked_parameters(
    models: DesignModels, logs: Sequence[WalkerLog], number: int, walk_s: float, peak_n: float
) -> FootParameters:
    """Return the parameters that a made foot finds while it walks.

    Args:
        models: Models of its type.
        logs: What the feet of a robot felt; the foot is on the leg of its number.
        number: Number of the foot.
        walk_s: Time of walking [s].
        peak_n: Peak to which the loads are scaled [N].
    """
    foot = Specimen(models.response, draw_deviations(models.response, PAPER_TOLERANCES, _SEED, number))
    known, loads = _as_designed(foot), _loads(logs, number, walk_s, peak_n)
    readings, walking = read_walker(foot, loads, number, scan=_SCAN, viscous_rel=1.0), _walking(models, known)
    walking.add(_scans(models, readings, known))
    walking.judge()
    return walking.parameters()


def _loads(logs: Sequence[WalkerLog], number: int, walk_s: float, peak_n: float | None = None) -> WalkerLoads:
    """Return the loads of one leg over a lead-in in the air and a time [s] of the logs, repeated, scaled to a peak."""
    parts = [
        walker_loads(log, 1.0 if peak_n is None else peak_n / log.peak_n(), _BALL_RADIUS_MM) for log in logs
    ]
    leg, step_s = number % parts[0].force_n.shape[1], parts[0].t_s[1] - parts[0].t_s[0]
    t_s = np.asarray(step_s * np.arange(round((walk_s + 2.0) / step_s)), np.float64)
    force_n, normal = (
        np.concatenate([getattr(part, name)[:, leg : leg + 1] for part in parts])
        for name in ("force_n", "normal")
    )
    rows = np.arange(len(t_s)) % len(force_n)
    return WalkerLoads.of_still_feet(t_s, force_n[rows], normal[rows])


def _scans(models: DesignModels, readings: WalkerReadings, parameters: FootParameters) -> LegScans:
    """Return readings of one foot as the cycles of the service have them."""
    network = models.network_for_rows(1)
    outputs = run_pipeline(judging_pipeline(network, models.response, readings.scan, [parameters]), readings)
    n = len(readings.t_s)
    t_ns, capacitance_pf = np.zeros((n, ELEMENTS), np.int64), np.full((n, ELEMENTS), np.nan)
    read_pf = readings.capacitance_pf[:, 0]
    read_pf = np.where(read_pf >= readings.scan.range_end_pf, np.nan, read_pf)
    for row, elements in enumerate(readings.elements):
        if row:
            t_ns[row], capacitance_pf[row] = t_ns[row - 1], capacitance_pf[row - 1]
        t_ns[row, elements] = (1e9 * readings.t_s[row]).astype(np.int64)
        capacitance_pf[row, elements] = read_pf[row]
    return LegScans(t_ns, capacitance_pf, IS_USABLE_STATE[outputs.state[:, 0]] & ~outputs.contact[:, 0])


def _worn_pf(
    models: DesignModels,
    foot: Specimen,
    scans: LegScans,
    creep_rel: float,
    floor_pf: float,
    random: np.random.Generator,
) -> Vector:
    """Return the readings of a foot whose elements creep by different shares, on a floor that adds capacitance."""
    design = models.response.design
    share = creep_rel * random.normal(size=ELEMENTS)
    closure_um = design.closure_um(scans.capacitance_pf - foot.stray_pf, foot.unloaded_pf - foot.stray_pf)
    step_s = 1e-9 * float(np.median(np.diff(scans.t_ns[:, 0])))
    crept_um, kept = np.zeros_like(closure_um), np.exp(-step_s / _CREEP_S)
    for row, now_um in enumerate(np.nan_to_num(closure_um[:-1])):
        crept_um[row + 1] = now_um + kept * (crept_um[row] - now_um)
    unloaded_um = design.plate_distance_um(foot.unloaded_pf - foot.stray_pf)
    area_pf_um = design.plate_distance_um(np.ones(1))
    distance_um = np.maximum(unloaded_um - closure_um - share * crept_um, 1.0)
    added_pf = draw_floor_pf(floor_pf, random) * ~scans.hangs[:, None]
    worn_pf: Vector = area_pf_um / distance_um + foot.stray_pf + added_pf
    return worn_pf


def _judging_loads(loads: WalkerLoads, random: np.random.Generator) -> tuple[Vector, Vector]:
    """Return normals and forces [N] of random times in the stances, shape (n, 3) each."""
    size_n = np.linalg.norm(loads.force_n[:, 0], axis=1)
    usual_n = np.percentile(size_n[size_n > 0.0], 98)
    rows = random.choice(np.flatnonzero(size_n > _MIN_SIZE_REL * usual_n), _N_LOADS)
    return loads.normal[rows, 0], loads.force_n[rows, 0]


#: What the service knows of a foot before, and its wear, by name.
CASES: dict[str, dict[str, Any]] = {
    "as made, not calibrated": {},
    "gains drifted by 4 % since a calibration": {"known": "drifted"},
    "drifted, elements creep apart by 1 %": {"known": "drifted", "creep_rel": 0.01},
    "drifted, elements creep apart by 3 %": {"known": "drifted", "creep_rel": 0.03},
    "drifted, on a floor that adds 0.1 pF": {"known": "drifted", "floor_pf": 0.1},
    "calibrated and right": {"known": "right"},
    "right, elements creep apart by 3 %": {"known": "right", "creep_rel": 0.03},
    "right, on a floor that adds 0.1 pF": {"known": "right", "floor_pf": 0.1},
    "drifted, half as stiff as designed": {"known": "drifted", "stiffness_rel": -0.5},
    "drifted, off the response table by 3 %": {"known": "drifted", "off_table_rel": 0.03},
    "drifted, a line is cut after 20 s": {"known": "drifted", "cut_s": 20.0},
}


def walking_figures(n_feet: int, cases: Sequence[str] = tuple(CASES)) -> dict[str, list[Values]]:
    """Return the figures of feet 0, 1, ... by case, one case after the other; as of `walked_foot_figures`."""
    parts = [(cases[number % len(cases)], number) for number in range(n_feet)]
    figures = compute_each(_figures_of_part, parts)
    return {
        case: [found for (of, _), found in zip(parts, figures, strict=True) if of == case] for case in cases
    }


def _figures_of_part(part: tuple[str, int]) -> Values:
    case, number = part
    models = DesignModels.load(released_folder(_FOOT_TYPE))
    return walked_foot_figures(models, walked_logs(), number, **CASES[case])


def walked_logs() -> list[WalkerLog]:
    """Return what the feet of a robot felt in the gaits of a walk."""
    runs = [run for gait in _GAITS for run in NEW_JUDGEMENT if run[:3] == (_FOOT_TYPE, gait, "flat")]
    return [run.kept_log() for run in runs]


def as_markdown(figures: Mapping[str, Sequence[Values]]) -> str:
    """Return the table of the figures of `walking_figures`, and of all cases together."""
    last = f"{_MARKS_S[-1]:g} s"
    rows = []
    everyone = [foot for of_case in figures.values() for foot in of_case]
    for case, feet in {**figures, "all": everyone}.items():
        before_deg = np.array([foot["before_deg"] for foot in feet])
        after_deg = np.array([[foot[f"{mark_s:g} s"]["after_deg"] for mark_s in _MARKS_S] for foot in feet])
        sigma_deg = np.array([foot[last]["turned_sigma_deg"] for foot in feet])
        proposed = np.array([not foot["objection"] for foot in feet])
        gained_deg = before_deg - after_deg[:, -1]
        gains = gained_deg > WORTH_DEG
        rows.append(
            (
                case,
                str(len(feet)),
                f"{before_deg.mean():.2f}, {before_deg.max():.1f}",
                *(f"{one.mean():.2f}, {one.max():.1f}" for one in after_deg.T),
                f"{np.mean([foot[last]['within_2_sigma'] for foot in feet]):.0%}",
                f"{np.count_nonzero(proposed & gains)} of {np.count_nonzero(gains)}",
                f"{np.count_nonzero(proposed & (gained_deg < 0.0))}",
                f"{np.count_nonzero(proposed & (gained_deg < -2.0 * sigma_deg))}",
            )
        )
    marks = " | ".join(f"{mark_s:g} s" for mark_s in _MARKS_S)
    return table(
        f"direction, mean and worst foot [deg] | feet | before | {marks} | within 2 sigma"
        " | would gain, proposed of these | proposed and worse | by over 2 sigma",
        rows,
    )
