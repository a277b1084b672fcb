"""Simulated walks on rough ground, and how right the gait tracker's events, contacts and slips are."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from footsense.estimation.baseline import ContactDetector
from footsense.estimation.gait import GaitTracker
from footsense.estimation.missing_elements import trimmed_means
from footsense.foot.directions import angles_between_deg
from footsense.foot.response_table import FootResponse
from footsense.frames import LEGS, GaitEvent, GaitEventKind, Mask, Stamps, Vector
from footsense.lab.evaluation.rough_gait import FRICTION, RoughGait, TrueSlip
from footsense.lab.training.gait_readings import (
    STEP_S,
    GaitReadings,
    ReadingConditions,
    concatenate_gaits,
    simulate_gait_readings,
)
from footsense.lab.training.gait_windows import complete_window_ends, estimate_in_batches, windows_of
from footsense.ports import LoadEstimate, LoadEstimator, Window

#: Threshold of contact before swings have shown their noise, and error of a baseline [N].
THRESHOLD_N, _BASELINE_N = 0.03, 4e-3


class GaitOutputs(NamedTuple):
    """Outputs of the gait tracker after each of n conversions.

    Attributes:
        force_n: Estimated forces [N], shape (n, legs, 3), NaN where there is none: an element is beyond the converter's
            range.
        reported: Every event with the row of the conversion after which it was reported.
        contact: Debounced contact, shape (n, legs).
        normal: Normal of the ground, shape (n, legs, 3), NaN where there is none.
        tangential_over_normal: Tangential over normal force [1], shape (n, legs), NaN where there is none.
        friction: Learnt coefficient of friction [1], shape (n,).
    """

    force_n: Vector
    reported: list[tuple[int, GaitEvent]]
    contact: Mask
    normal: Vector
    tangential_over_normal: Vector
    friction: Vector


class RoughWalk(NamedTuple):
    """Truth and gait tracker's outputs of one walk on rough ground, after each of n conversions.

    Attributes:
        t_s: Times of sending [s], shape (n,).
        true_force_n: True forces at sending [N], shape (n, legs, 3).
        true_normal: True normals, same shape.
        slides: Truth of each leg on the ground.
        stance_intervals_s: Start and end of each stance of each leg [s], shapes (k, 2).
        told: What the gait tracker says.
    """

    t_s: Vector
    true_force_n: Vector
    true_normal: Vector
    slides: list[TrueSlip]
    stance_intervals_s: list[Vector]
    told: GaitOutputs


def simulate_walk(
    response: FootResponse,
    estimator: LoadEstimator,
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
    return RoughWalk(
        t_s=t_s,
        true_force_n=readings.true_force_at_sending_n.swapaxes(0, 1).astype(np.float64),
        true_normal=readings.true_normal_at_sending.swapaxes(0, 1).astype(np.float64),
        slides=[gait.true_slip(t_s) for gait in gaits],
        stance_intervals_s=[
            np.array([(start_s, start_s + stance.duration_s) for start_s, stance in gait.stances])
            for gait in gaits
        ],
        told=run_gait_tracker(readings, estimator, n_per_rel, np.asarray(1e9 * t_s, np.int64)),
    )


def run_gait_tracker(
    readings: GaitReadings, estimator: LoadEstimator, n_per_rel: float, t_ns: Stamps
) -> GaitOutputs:
    """Return the gait tracker's outputs for readings, conversion by conversion."""
    n_legs, n = readings.closure_rel.shape
    loads, means_n = _estimate_loads_and_trimmed_means(readings, estimator)
    means_n *= n_per_rel
    contacts = [ContactDetector(THRESHOLD_N) for _ in range(n_legs)]
    tracker = GaitTracker(n_legs, period_ns=0)
    events, frames = [], []
    for k in range(n):
        load = LoadEstimate(*(part[k] for part in loads))
        now_ns = int(t_ns[k])
        for contact, mean_n, predicted_n, sigma_n in zip(
            contacts,
            means_n[k].tolist(),
            load.force_n[:, 2].tolist(),
            load.sigma_n[:, 2].tolist(),
            strict=True,
        ):
            contact.observe(mean_n, _BASELINE_N, now_ns, now_ns, predicted_n, sigma_n)
        frame = tracker.observe(load, contacts, now_ns)
        assert frame is not None
        events += [(k, event) for event in frame.events]
        frames.append((frame.contact, frame.normal, frame.tangential_over_normal, frame.friction))
    return GaitOutputs(loads.force_n, events, *(np.array(part) for part in zip(*frames, strict=True)))


def _estimate_loads_and_trimmed_means(
    readings: GaitReadings, estimator: LoadEstimator
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


#: Time at the begin of each walk in which thresholds and friction are learnt [s].
WARM_UP_S = 10.0
#: Peak of the stances, and swing before them, whose touchdowns count [N], [s].
PEAK_N, SWING_DURATION_RANGE_S = 0.1, 0.1
#: Normal force from which tangential over normal force, and from which normals count [N].
MIN_FRICTION_FORCE_N, MIN_NORMAL_FORCE_N = 0.3, 0.5
#: Way of a slide that has to be reported [mm], and way below which nothing has slid.
SLID_MM, STUCK_MM = 5.0, 0.3
#: Way from one conversion to the next from which a foot slides [mm].
MIN_SLIDE_PER_CONVERSION_MM = 0.01
#: Share of a slide in which the force has to be known for the slide to count [1].
MIN_KNOWN_FORCE_SHARE = 0.5
#: A slip is false if tangential over normal force was this far below the ground's coefficient in the last conversions.
FALSE_SLIP_MARGIN, FALSE_SLIP_CONVERSIONS = 0.05, 30
#: Touchdowns that were reported later do not count in the error of the back-dated time [ms].
_MAX_SCORED_REPORT_DELAY_MS = 60.0
#: Time after a stance in which a word belongs to it [s].
_MAX_REPORT_AFTER_STANCE_S = 0.08


class _MatchedEvents(NamedTuple):
    """Report delay, time error and its sigma [ms] of each true touchdown and lift-off; infinite delay if missed."""

    touchdown_timings_ms: list[tuple[float, float, float]]
    lift_off_timings_ms: list[tuple[float, float, float]]
    n_false_touchdowns: int


class _SlipReports(NamedTuple):
    """Reported slips matched with true slides: sliding distance until the report [mm] (infinite if never)."""

    slides_before_report_mm: list[float]
    n_slides_with_unknown_force: int
    n_false_slips: int
    n_slip_reports_without_slide: int


def _friction_ratio_and_normal_force(force_n: Vector, normal: Vector) -> tuple[Vector, Vector]:
    """Return true tangential over normal force [1], NaN without a load, and normal force [N], shapes (...)."""
    pressing_n = (force_n * normal).sum(axis=-1)
    tangential_n = np.linalg.norm(force_n - pressing_n[..., None] * normal, axis=-1)
    return np.where(pressing_n > 0.0, tangential_n / np.maximum(pressing_n, 1e-9), np.nan), pressing_n


def _evaluated_stances(walk: RoughWalk, leg: int) -> Iterator[tuple[int, float, float, Mask]]:
    """Yield number, start [s], end [s] and conversion mask (n,) of each stance that is evaluated."""
    for number, (start_s, end_s) in enumerate(walk.stance_intervals_s[leg].tolist()):
        if start_s > WARM_UP_S and end_s + _MAX_REPORT_AFTER_STANCE_S < walk.t_s[-1]:
            yield number, start_s, end_s, walk.slides[leg].stance_number == number


def _match_touchdowns_and_lift_offs(walk: RoughWalk, leg: int) -> _MatchedEvents:
    """Match a leg's reported touchdowns and lift-offs with its true stances."""
    found = _MatchedEvents([], [], 0)
    words = [(walk.t_s[row], event) for row, event in walk.told.reported if event.leg == leg]
    down, up = (
        np.array([(t_s, 1e-9 * e.t_ns, e.sigma_s) for t_s, e in words if e.kind is kind]).reshape(-1, 3)
        for kind in (GaitEventKind.TOUCHDOWN, GaitEventKind.LIFT_OFF)
    )
    starts_s, ends_s = walk.stance_intervals_s[leg].T
    in_stance = ((down[:, :1] >= starts_s) & (down[:, :1] < ends_s + _MAX_REPORT_AFTER_STANCE_S)).any(axis=1)
    n_false = int((~in_stance & (down[:, 0] > WARM_UP_S)).sum())
    for number, start_s, end_s, rows in _evaluated_stances(walk, leg):
        before_s = start_s - (ends_s[number - 1] if number else 0.0)
        if walk.true_force_n[rows, leg, 2].max(initial=0.0) < PEAK_N or before_s < SWING_DURATION_RANGE_S:
            continue
        for reported, true_s, first_s, last_s in (
            (down, start_s, start_s, end_s),
            (up, end_s, end_s, end_s + _MAX_REPORT_AFTER_STANCE_S),
        ):
            own = reported[(reported[:, 0] >= first_s) & (reported[:, 0] < last_s)]
            kept = found.touchdown_timings_ms if reported is down else found.lift_off_timings_ms
            row = 1e3 * (own[0] - (true_s, true_s, 0.0)) if len(own) else np.array((np.inf, np.nan, np.nan))
            kept.append((float(row[0]), float(row[1]), float(row[2])))
    return found._replace(n_false_touchdowns=n_false)


def _match_slip_reports(walk: RoughWalk, leg: int) -> _SlipReports:
    """Match a leg's reported slips with its true slides."""
    ratio, pressing_n = _friction_ratio_and_normal_force(walk.true_force_n[:, leg], walk.true_normal[:, leg])
    slides = walk.slides[leg]
    room = ratio - slides.kinetic_friction
    reported = np.array(
        [row for row, e in walk.told.reported if e.leg == leg and e.kind is GaitEventKind.SLIP], int
    )
    moving = np.diff(slides.slid_mm, append=0.0) > MIN_SLIDE_PER_CONVERSION_MM
    slide_distances_mm, n_beyond_range, n_false, at_cone = [], 0, 0, 0
    for number, _, _, rows in _evaluated_stances(walk, leg):
        own = reported[slides.stance_number[reported] == number]
        where = np.flatnonzero(rows)
        for row in own.tolist():
            lately = room[max(row - FALSE_SLIP_CONVERSIONS, where[0]) : row + 1]
            if np.nanmax(lately, initial=-np.inf) < -FALSE_SLIP_MARGIN:
                n_false += 1
            elif slides.slid_mm[where[-1]] < STUCK_MM:
                at_cone += 1
        firm = where[pressing_n[where] > MIN_FRICTION_FORCE_N]
        if len(firm) and slides.slid_mm[firm[-1]] - slides.slid_mm[firm[0]] > SLID_MM:
            known = np.isfinite(walk.told.force_n[firm[moving[firm]], leg, 2])
            if known.size and known.mean() < MIN_KNOWN_FORCE_SHARE:
                n_beyond_range += 1
                continue
            begun_mm = slides.slid_mm[firm[0]]
            in_time = own[own <= firm[-1]]
            slide_distances_mm.append(
                max(float(slides.slid_mm[in_time[0]] - begun_mm), 0.0) if len(in_time) else np.inf
            )
    return _SlipReports(slide_distances_mm, n_beyond_range, n_false, at_cone)


def score_walks(walks: list[RoughWalk]) -> dict[str, float]:
    """Return how right the reported events, contacts, normals, friction ratios and slips of walks are, by name."""
    legs = [(walk, leg) for walk in walks for leg in range(len(walk.slides))]
    flanks = [_match_touchdowns_and_lift_offs(walk, leg) for walk, leg in legs]
    slips = [_match_slip_reports(walk, leg) for walk, leg in legs]
    downs = np.array([row for one in flanks for row in one.touchdown_timings_ms])
    ups = np.array([row for one in flanks for row in one.lift_off_timings_ms])
    before_mm = np.array([way for one in slips for way in one.slides_before_report_mm])
    reported_mm = before_mm[np.isfinite(before_mm)]
    down_ms, up_ms = downs[downs[:, 0] < _MAX_SCORED_REPORT_DELAY_MS], ups[np.isfinite(ups[:, 0])]
    frictions, normals_deg, stands, contacts, learnt = [], [], [], [], []
    for walk in walks:
        ratio, pressing_n = _friction_ratio_and_normal_force(walk.true_force_n, walk.true_normal)
        later = walk.t_s > WARM_UP_S
        judged = (pressing_n > MIN_FRICTION_FORCE_N) & later[:, None]
        frictions.append((walk.told.tangential_over_normal - ratio)[judged])
        firm = (pressing_n > MIN_NORMAL_FORCE_N) & np.isfinite(walk.told.normal[..., 0])
        normals_deg.append(angles_between_deg(walk.told.normal[firm], walk.true_normal[firm]))
        stands.append(np.stack([slides.stance_number[later] >= 0 for slides in walk.slides], axis=1))
        contacts.append(walk.told.contact[later])
        true = np.nanmean([slides.kinetic_friction for slides in walk.slides])
        learnt.append(walk.told.friction[-1] - true)
    stand = np.concatenate(stands)
    hours = float(stand.size * np.diff(walks[0].t_s).mean()) / 3600.0
    delay_p50_ms, delay_p95_ms = np.percentile(downs[:, 0], (50, 95), method="nearest").tolist()
    return {
        "leg_minutes": 60 * hours,
        "swing_minutes": 60 * hours * float((~stand).mean()),
        "n_touchdowns": len(downs),
        "touchdown_delay_p50_ms": delay_p50_ms,
        "touchdown_delay_p95_ms": delay_p95_ms,
        "missed_touchdown_share": float(np.isinf(downs[:, 0]).mean()),
        "n_false_touchdowns": sum(one.n_false_touchdowns for one in flanks),
        "touchdown_time_error_rms_ms": _rms(down_ms[:, 1]),
        "touchdown_time_error_rms_sigmas": _rms(down_ms[:, 1] / down_ms[:, 2]),
        "lift_off_time_error_rms_ms": _rms(up_ms[:, 1]),
        "contact_correct_share": float((np.concatenate(contacts) == stand).mean()),
        "tangential_over_normal_error": float(np.nanmean(np.abs(np.concatenate(frictions)))),
        "normal_error_deg": float(np.concatenate(normals_deg).mean()),
        "n_slides": len(before_mm),
        "n_slides_beyond_range": sum(one.n_slides_with_unknown_force for one in slips),
        "slide_before_report_mm": float(reported_mm.mean()) if len(reported_mm) else np.nan,
        "missed_slide_share": float(np.isinf(before_mm).mean()) if len(before_mm) else np.nan,
        "n_false_slips": sum(one.n_false_slips for one in slips),
        "n_slips_without_slide": sum(one.n_slip_reports_without_slide for one in slips),
        "friction_coefficient_error_rms": _rms(np.array(learnt)),
    }


def _rms(errors: Vector) -> float:
    known = errors[np.isfinite(errors)]  # nothing is learnt in a short walk
    return float(np.sqrt((known**2).mean())) if known.size else np.nan
