"""Simulated walks on rough ground: estimated contacts, normals and slips of six feet, with the true ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from footsense.estimation.baseline import ContactDetector, trimmed_means
from footsense.estimation.gait import GaitTracker
from footsense.foot.response_table import FootResponse
from footsense.frames import LEGS, GaitEvent, Mask, Stamps, Vector
from footsense.lab.evaluation.rough_gait import FRICTION, RoughGait, TrueSlip
from footsense.lab.training.gait_readings import (
    STEP_S,
    GaitReadings,
    ReadingConditions,
    concatenate_gaits,
    simulate_gait_readings,
)
from footsense.lab.training.gait_windows import complete_window_ends, estimate_in_batches, windows_of
from footsense.ports import Estimator, LoadEstimate, Window

#: Threshold of contact before swings have shown their noise, and error of a baseline [N].
THRESHOLD_N, _BASELINE_N = 0.03, 4e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RoughWalk:
    """Truth and gait tracker's outputs of one walk on rough ground, after each of n conversions.

    Attributes:
        t_s: Times of sending [s], shape (n,).
        true_force_n: True forces at sending [N], shape (n, legs, 3).
        true_normal: True normals, same shape.
        slides: Truth of each leg on the ground.
        stance_intervals_s: Start and end of each stance of each leg [s], shapes (k, 2).
        reported_events: Every event with the row of the conversion after which it was reported.
        has_load_estimate: Whether the force is known, shape (n, legs): all elements are within the converter's range.
        debounced_contact: Debounced contact, shape (n, legs).
        estimated_normal: Normal of the ground, shape (n, legs, 3), NaN where there is none.
        tangential_over_normal: Tangential over normal force [1], shape (n, legs), NaN where there is none.
        estimated_friction_coefficient: Learnt coefficient of friction, shape (n,).
    """

    t_s: Vector
    true_force_n: Vector
    true_normal: Vector
    slides: list[TrueSlip]
    stance_intervals_s: list[Vector]
    reported_events: list[tuple[int, GaitEvent]]
    has_load_estimate: Mask
    debounced_contact: Vector
    estimated_normal: Vector
    tangential_over_normal: Vector
    estimated_friction_coefficient: Vector


def simulate_walk(
    response: FootResponse,
    estimator: Estimator,
    n_per_rel: float,
    max_n: float,
    seed: tuple[int, int],
    n: int,
) -> RoughWalk:
    """Return one simulated walk on random rough ground, with estimates and truth.

    Args:
        response: Response of the feet.
        estimator: The network, for any number of rows.
        n_per_rel: Load along the leg over the trimmed mean of the closures [N].
        max_n: Full load of a foot [N].
        seed: Seed of gaits and noise.
        n: Number of conversions.
    """
    rng = np.random.default_rng(seed)
    friction = rng.uniform(*FRICTION)
    gaits = [RoughGait(rng, max_n, n * STEP_S, friction) for _ in LEGS]
    conditions = ReadingConditions(baseline_drift_rms_pf=0.3e-3)
    readings = concatenate_gaits(
        [simulate_gait_readings(response, gait.loads, conditions, rng, n) for gait in gaits]
    )
    t_s = STEP_S * np.arange(1.0, n + 1) + readings.send_delay_s.mean(axis=0)
    found = run_gait_tracker(readings, estimator, n_per_rel, np.asarray(1e9 * t_s, np.int64))
    return RoughWalk(
        t_s=t_s,
        true_force_n=readings.true_force_at_sending_n.swapaxes(0, 1).astype(np.float64),
        true_normal=readings.true_normal_at_sending.swapaxes(0, 1).astype(np.float64),
        slides=[gait.true_slip(t_s) for gait in gaits],
        stance_intervals_s=[
            np.array([(start_s, start_s + stance.duration_s) for start_s, stance in gait.stances])
            for gait in gaits
        ],
        reported_events=found.reported,
        has_load_estimate=found.has_estimate,
        debounced_contact=np.array(found.contact, np.float64),
        estimated_normal=np.array(found.normal),
        tangential_over_normal=np.array(found.tangential_over_normal),
        estimated_friction_coefficient=np.array(found.estimated_friction_coefficient),
    )


@dataclass(slots=True)
class GaitOutputs:
    """Outputs of the gait tracker after each conversion: events, contact, ground normal, friction.

    Attributes:
        force_n: Estimated forces [N], shape (n, legs, 3), NaN where there is none.
        reported: Events, each with the conversion after which it was reported.
        has_estimate: Whether the force is known, shape (n, legs).
        contact: Debounced contact of each leg.
        normal: Normal of the ground.
        tangential_over_normal: Tangential over normal force [1].
        estimated_friction_coefficient: Learnt coefficient of friction [1].
    """

    force_n: Vector
    reported: list[tuple[int, GaitEvent]]
    has_estimate: Mask
    contact: list[Sequence[bool]]
    normal: list[Vector]
    tangential_over_normal: list[Vector]
    estimated_friction_coefficient: list[float]


def run_gait_tracker(
    readings: GaitReadings, estimator: Estimator, n_per_rel: float, t_ns: Stamps
) -> GaitOutputs:
    """Return the gait tracker's outputs for readings, conversion by conversion."""
    n_legs, n = readings.closure_rel.shape
    loads, means_n = _estimate_loads_and_trimmed_means(readings, estimator)
    means_n *= n_per_rel
    contacts = [ContactDetector(THRESHOLD_N) for _ in range(n_legs)]
    tracker = GaitTracker(n_legs, period_ns=0)
    found = GaitOutputs(loads.force_n, [], np.isfinite(loads.force_n[..., 2]), [], [], [], [])
    for k in range(n):
        load = LoadEstimate(*(part[k] for part in loads))
        now_ns = int(t_ns[k])
        for contact, mean_n, predicted_n in zip(
            contacts, means_n[k].tolist(), load.force_n[:, 2].tolist(), strict=True
        ):
            contact.observe(mean_n, _BASELINE_N, now_ns, now_ns, predicted_n)
        frame = tracker.observe(load, contacts, now_ns)
        assert frame is not None
        found.reported += [(k, event) for event in frame.events]
        found.contact.append(frame.contact.tolist())
        found.normal.append(frame.normal)
        found.tangential_over_normal.append(frame.tangential_over_normal)
        found.estimated_friction_coefficient.append(frame.friction)
    return found


def _estimate_loads_and_trimmed_means(
    readings: GaitReadings, estimator: Estimator
) -> tuple[LoadEstimate, Vector]:
    """Return load estimates (n, legs, ...) and trimmed means of closures (n, legs); NaN where no window is complete."""
    n_legs, n = readings.closure_rel.shape
    windows = windows_of(readings)
    gait, time = np.nonzero(complete_window_ends(readings))
    loads = LoadEstimate(*(np.full((n, n_legs, width), np.nan) for width in (3, 3, 4, 4)))
    missing = np.zeros(windows.closure_rel[:, 0].shape, bool)
    found = estimate_in_batches(estimator, Window(windows.closure_rel, windows.age_s, missing))
    for whole, part in zip(loads, found, strict=True):
        whole[time, gait] = part
    means = np.full((n, n_legs), np.nan)
    means[time, gait] = trimmed_means(windows.closure_rel[:, 0])
    return loads, means
