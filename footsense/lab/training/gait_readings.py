"""Simulated readings of a foot in random gaits: sequential conversions with noise, delays and drift.

A conversion reads one element at its own time; the truth that belongs to it is the load at the time at which a force
estimated from it would be sent. Half a minute of walking is thousands of windows of readings.
"""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from firmware_interface.chips import ad7147
from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads, Specimen
from footsense.frames import ELEMENTS, Vector
from footsense.lab.training.load_cases import BASELINE_NOISE_PF, FULL_SCALE_PF, NOISE_PF, sensed_closure_um
from footsense.lab.training.random_gait import RandomGait
from footsense.progress import progress_bar
from footsense.sim.rubber import RUBBER_LEVELS, ViscoelasticRubber
from footsense.sim.scene import RubberLevel

#: Share of the gaits that are read in the second order, at any pace, and of those sent later.
_RASTER_SHARE, _PACED_SHARE, _LATE_SHARE = 0.1, 0.2, 0.15
#: Share of the gaits on rubber that creeps and lags, and the most of it over that of its level [1].
_VISCOUS_SHARE, _MOST_VISCOUS = 0.2, 1.5
#: Levels of that rubber, by how often they come.
_LEVELS: tuple[RubberLevel, ...] = (*5 * ("assumed",), "threefold", "insole")
#: Share of stances with a load that shakes as under a learned policy, and the most of a gait that goes by unread [s].
_SHAKING_SHARE, _UNREAD_S = 0.1, 2.0
#: Time of a conversion of a FDC1004 and from its middle to the sending of a force, where a transaction takes the host
#: 100 us [s]; the time of a stage of an AD7147.
STEP_S, NOMINAL_SEND_DELAY_S = 2.931e-3, 4.142e-3
AD7147_STAGE_S = 1e-9 * ad7147.DECIMATIONS[64].stage_ns
#: Fastest and slowest conversion over that of a FDC1004 [1]: a scan of 4.5 ms to one of 125 ms. Latest sending [s].
PACE_REL, _LATEST_S = (0.17, 4.7), 8e-3
#: Standard deviation of a clock at any pace [1], and of the time of sending [s].
_CLOCK_REL, _JITTER_S = 0.01, 3e-5


class _BoardPace(NamedTuple):
    """How a board reads: conversion [s], its largest deviation by clock and host [1], least and most delay, range."""

    step_s: float
    most_off_rel: float
    send_delay_s: tuple[float, float]
    range_end_pf: float


_AD7147 = _BoardPace(AD7147_STAGE_S, 0.04, (1.2e-3, 4e-3), ad7147.RANGE_END_PF)
_FDC1004 = _BoardPace(STEP_S, 0.05, (2.5e-3, 5.5e-3), FULL_SCALE_PF)
#: Share of the AD7147 of the gaits that a board reads.
_AD7147_SHARE = 0.5
#: Drift of a baseline since it was last followed [pF, rms], and share of the gaits with one.
_DRIFT_PF, _DRIFT_SHARE = 0.3e-3, 0.5


class GaitReadings(NamedTuple):
    """Simulated readings and true loads of m gaits of n readings each.

    Attributes:
        conversion_order_index: Index into `CONVERSION_ORDERS` of each gait, shape (m,).
        step_s: Time of a conversion of each gait [s], shape (m,).
        send_delay_s: Time from the middle of each reading's conversion to sending [s], shape (m, n).
        closure_rel: Measured closure of each reading's own element over the gap [1], shape (m, n); at most that at
            the end of the converter's range.
        in_range: Whether the reading was within the converter's range, shape (m, n).
        true_force_at_sending_n: True force at sending [N], shape (m, n, 3).
        true_normal_at_sending: True normal of the contact at sending, shape (m, n, 3); up in the air.
    """

    conversion_order_index: NDArray[np.intp]
    step_s: Vector
    send_delay_s: Vector
    closure_rel: NDArray[np.float32]
    in_range: NDArray[np.bool_]
    true_force_at_sending_n: NDArray[np.float32]
    true_normal_at_sending: NDArray[np.float32]


def conversion_elements(order: int, n: int) -> NDArray[np.intp]:
    """Return the element index of each of n successive readings, shape (n,)."""
    return np.resize(np.array(list(CONVERSION_ORDERS.values())[order], np.intp), n)


def equivalent_elastic_load(
    t_s: Vector, normal: Vector, force_n: Vector, amount: float, level: RubberLevel
) -> tuple[Vector, Vector]:
    """Return normal and force of the elastic loads that deform a foot as these do one that creeps and lags.

    Args:
        t_s: Times of n loads [s], shape (n,).
        normal: Contact normals, shape (n, 3).
        force_n: Forces [N], shape (n, 3).
        amount: Creep and lag over those of the level [1].
        level: Level of the rubber.
    """
    rubber = ViscoelasticRubber(*RUBBER_LEVELS[level])
    normals, forces = normal.copy(), np.empty_like(force_n)
    for k, t_ns in enumerate((t_s * 1e9).astype(np.int64).tolist()):
        normals[k], sensed_n = rubber.next_effective_load(t_ns, normal[k], force_n[k])
        forces[k] = force_n[k] + amount * (sensed_n - force_n[k])
    return normals, forces


def _gait_closures_um(foot: Specimen, t_s: Vector, normal: Vector, force_n: Vector) -> Vector:
    """Return the closures at the times [um], shape (n, elements)."""
    closure_um = np.zeros((len(t_s), ELEMENTS))
    loaded = force_n.any(axis=1)
    if loaded.any():
        closure_um[loaded] = sensed_closure_um(foot, normal[loaded], force_n[loaded])
    return closure_um


def nominal_send_delay_s(step_s: Any) -> Any:
    """Return the nominal delay from the middle of a conversion to sending [s], from the conversion time [s]."""
    return NOMINAL_SEND_DELAY_S + 0.6 * (step_s - STEP_S)


class ReadingConditions(NamedTuple):
    """Conditions of a simulated gait: conversion order and timing, viscoelasticity, baseline drift.

    Attributes:
        conversion_order_index: Index into `CONVERSION_ORDERS`.
        step_s: Time of a conversion [s].
        send_delay_s: Time from the middle of a conversion to the sending of a force [s].
        viscous_rel: Creep and lag of the rubber over those of its level [1].
        rubber_level: Level of the rubber.
        baseline_drift_rms_pf: Drift of the baselines since they were last followed [pF, rms].
        noise_pf: Noise of a conversion [pF, rms].
        range_end_pf: Largest capacitance that the converter reads [pF].
    """

    conversion_order_index: int = 0
    step_s: float = STEP_S
    send_delay_s: float = NOMINAL_SEND_DELAY_S
    viscous_rel: float = 0.0
    rubber_level: RubberLevel = "assumed"
    baseline_drift_rms_pf: float = 0.0
    noise_pf: float = NOISE_PF
    range_end_pf: float = FULL_SCALE_PF


def simulate_gait_readings(
    response: FootResponse,
    loads: Callable[[Vector], ContactLoads],
    conditions: ReadingConditions,
    rng: np.random.Generator,
    n: int,
    felt: Callable[[Vector], ContactLoads] | None = None,
) -> GaitReadings:
    """Return the simulated readings of one gait, as arrays with a first axis of length 1.

    Args:
        response: Response of the foot.
        loads: Returns the loads at some times [s].
        conditions: How it is read.
        rng: Source of the noise.
        n: Number of conversions.
        felt: The same with what the sensor feels besides; None for nothing.
    """
    design = response.design
    send_delay_s = conditions.send_delay_s + _JITTER_S * rng.normal(size=n)
    t_s: Vector = np.asarray(conditions.step_s * np.arange(1.0, n + 1), np.float64)
    read, sent = (felt or loads)(t_s), loads(t_s + send_delay_s)
    normal, force_n = (
        equivalent_elastic_load(t_s, *read, conditions.viscous_rel, conditions.rubber_level)
        if conditions.viscous_rel
        else read
    )
    closure_um = _gait_closures_um(Specimen(response), t_s, normal, force_n)
    element = conversion_elements(conditions.conversion_order_index, n)
    capacitance_pf = design.capacitance_pf(closure_um[np.arange(n), element])
    measured_pf = np.minimum(
        capacitance_pf + conditions.noise_pf * rng.normal(size=n), conditions.range_end_pf
    )
    off_pf = float(np.hypot(BASELINE_NOISE_PF, conditions.baseline_drift_rms_pf))
    baseline_pf = design.unloaded_pf + off_pf * rng.normal(size=ELEMENTS)
    closure_rel = design.closure_um(measured_pf, baseline_pf[element]) / design.gap_um
    return GaitReadings(
        conversion_order_index=np.array([conditions.conversion_order_index]),
        step_s=np.array([conditions.step_s]),
        send_delay_s=send_delay_s[None],
        closure_rel=closure_rel[None].astype(np.float32),
        in_range=(measured_pf < conditions.range_end_pf)[None],
        true_force_at_sending_n=sent.force_n[None].astype(np.float32),
        true_normal_at_sending=sent.normal[None].astype(np.float32),
    )


def draw_conditions(rng: np.random.Generator, slowest_rel: float = PACE_REL[1]) -> ReadingConditions:
    """Return random conditions of a gait of the training: of a board, or of any pace.

    Args:
        rng: Source of the draws.
        slowest_rel: Slowest conversion over the usual one [1].
    """
    board = _AD7147 if rng.random() < _AD7147_SHARE else _FDC1004
    if rng.random() < _PACED_SHARE:
        pace_rel = float(np.exp(rng.uniform(*np.log((PACE_REL[0], slowest_rel)))))
        step_s = STEP_S * pace_rel * (1.0 + _CLOCK_REL * rng.normal())
        send_delay_s = nominal_send_delay_s(step_s)
    else:
        step_s = board.step_s * (1.0 + board.most_off_rel * rng.uniform(-1.0, 1.0))
        send_delay_s = rng.uniform(*board.send_delay_s)
    if rng.random() < _LATE_SHARE:
        send_delay_s += rng.uniform(0.0, _LATEST_S)
    order = int(rng.random() < _RASTER_SHARE)
    level = _LEVELS[rng.integers(len(_LEVELS))]
    viscous, drifting = rng.random(2) < (_VISCOUS_SHARE, _DRIFT_SHARE)
    return ReadingConditions(
        conversion_order_index=order,
        step_s=step_s,
        send_delay_s=send_delay_s,
        viscous_rel=rng.uniform(0.0, _MOST_VISCOUS) if viscous else 0.0,
        rubber_level=level,
        baseline_drift_rms_pf=_DRIFT_PF if drifting else 0.0,
        range_end_pf=board.range_end_pf,
    )


def simulate_random_gait_readings(
    response: FootResponse,
    rng: np.random.Generator,
    n: int,
    max_n: float,
) -> GaitReadings:
    """Return the simulated readings of a part of one random gait, as `simulate_gait_readings`.

    Args:
        response: Response of the foot.
        rng: Source of the draws.
        n: Number of conversions.
        max_n: Full load of the foot [N].
    """
    conditions, unread_s = draw_conditions(rng), rng.uniform(0.0, _UNREAD_S)
    gait = RandomGait(rng, max_n, unread_s + n * conditions.step_s, _SHAKING_SHARE)
    return simulate_gait_readings(response, lambda t_s: gait.loads(unread_s + t_s), conditions, rng, n)


def concatenate_gaits(gaits: list[GaitReadings]) -> GaitReadings:
    """Return gaits of equal length joined along the first axis."""
    arrays: list[Any] = [np.concatenate(parts) for parts in zip(*gaits, strict=True)]
    return GaitReadings(*arrays)


def simulate_side_by_side(calls: Iterable[Any], m: int, jobs: int, words: str) -> GaitReadings:
    """Return the readings of m gaits, each of a delayed call of joblib, joined along the first axis.

    Args:
        calls: The calls.
        m: Number of gaits.
        jobs: Processes.
        words: Title of the progress bar.
    """
    made: list[GaitReadings] = []
    with progress_bar(words, m) as gaits_done:
        for gait in Parallel(n_jobs=jobs, return_as="generator")(calls):
            made.append(gait)
            gaits_done(len(made))
    return concatenate_gaits(made)


def random_gaits(
    response: FootResponse,
    seed: int,
    m: int,
    n: int,
    max_n: float,
    jobs: int = 1,
) -> GaitReadings:
    """Return simulated readings of m random gaits; the same seed gives the same, on any number of processes.

    Args:
        response: Response of the foot.
        seed: Seed of the draws.
        m: Number of gaits.
        n: Conversions of each.
        max_n: Full load of the foot [N].
        jobs: Processes.
    """
    seeds = np.random.SeedSequence(seed).spawn(m)
    calls = (
        delayed(simulate_random_gait_readings)(response, np.random.default_rng(own), n, max_n)
        for own in seeds
    )
    return simulate_side_by_side(calls, m, jobs, "gaits")
