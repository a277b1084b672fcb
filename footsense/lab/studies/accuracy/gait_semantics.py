"""Study `gait-semantics`: accuracy of touchdown, ground normal, friction and slip estimates on rough ground."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from footsense.estimation.network import sensitivity
from footsense.foot.directions import angles_between_deg
from footsense.frames import GaitEventKind, Mask, Vector
from footsense.lab.evaluation.rough_walks import RoughWalk, simulate_walk
from footsense.lab.former_page import Plots, Study, StudyContext

#: Seed of the walks.
WALK_SEED = 990_308
#: Walks and conversions of each: a minute.
N_WALKS, CONVERSIONS, QUICK_CONVERSIONS = 8, 22_000, 7_000
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


@dataclass(frozen=True, slots=True)
class Results:
    """Results of the study `gait-semantics`: errors of events, contact, friction and normals.

    Attributes:
        leg_hours: Time of all legs together [h].
        swing_hours: Part of it in swing [h].
        n_touchdowns: Touchdowns that count.
        touchdown_delay_p50_ms: From the first load to the word, median [ms].
        touchdown_delay_p95_ms: The same, 95th percentile [ms].
        missed_touchdown_share: Share never reported [1].
        n_false_touchdowns: In swing, in all.
        touchdown_time_error_rms_ms: Error of the back-dated time of those reported promptly, rms [ms].
        touchdown_time_error_rms_sigmas: The same over its sigma, rms [1].
        n_reported_lift_offs: Lift-offs that were reported.
        lift_off_time_error_rms_ms: Error of the back-dated time, rms [ms].
        contact_correct_share: Share of the conversions whose contact is right [1].
        mean_abs_tangential_over_normal_error: Error of tangential over normal force, mean [1].
        mean_contact_normal_error_deg: Error of the normal, mean [deg].
        n_slides_with_unknown_force: Slides that drive the foot beyond the converter's range, where no force is known.
        n_reportable_slides: Slides that have to be reported.
        mean_slide_before_report_mm: Way until they are, mean [mm].
        slide_before_report_p95_mm: The same, 95th percentile [mm].
        missed_slide_share: Share never reported [1].
        n_false_slips: Reported far below the cone, in all.
        n_slip_reports_without_slide: Said at the cone without a way worth the name, in all.
        friction_coefficient_error_rms: Error of the learnt coefficient at the end of a walk, rms [1].
    """

    leg_hours: float
    swing_hours: float
    n_touchdowns: int
    touchdown_delay_p50_ms: float
    touchdown_delay_p95_ms: float
    missed_touchdown_share: float
    n_false_touchdowns: int
    touchdown_time_error_rms_ms: float
    touchdown_time_error_rms_sigmas: float
    n_reported_lift_offs: int
    lift_off_time_error_rms_ms: float
    contact_correct_share: float
    mean_abs_tangential_over_normal_error: float
    mean_contact_normal_error_deg: float
    n_slides_with_unknown_force: int
    n_reportable_slides: int
    mean_slide_before_report_mm: float
    slide_before_report_p95_mm: float
    missed_slide_share: float
    n_false_slips: int
    n_slip_reports_without_slide: int
    friction_coefficient_error_rms: float


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
    words = [(walk.t_s[row], event) for row, event in walk.reported_events if event.leg == leg]
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
        [row for row, e in walk.reported_events if e.leg == leg and e.kind is GaitEventKind.SLIP], int
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
            if walk.has_load_estimate[firm[moving[firm]], leg].mean() < MIN_KNOWN_FORCE_SHARE:
                n_beyond_range += 1
                continue
            begun_mm = slides.slid_mm[firm[0]]
            in_time = own[own <= firm[-1]]
            slide_distances_mm.append(
                max(float(slides.slid_mm[in_time[0]] - begun_mm), 0.0) if len(in_time) else np.inf
            )
    return _SlipReports(slide_distances_mm, n_beyond_range, n_false, at_cone)


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Simulate walks on rough ground; return the errors of the estimated events, contacts and slips."""
    n_per_rel = sensitivity(context.network, 1, context.trained_inputs.moments).load_n_per_mean_closure
    n = QUICK_CONVERSIONS if context.quick else CONVERSIONS
    walks = []
    for number in range(1 if context.quick else N_WALKS):
        max_n = context.foot_design.loads.max_n
        walks.append(
            simulate_walk(context.response, context.network, n_per_rel, max_n, (WALK_SEED, number), n)
        )
        context.report_progress(f"gait-semantics: walk {number + 1}")
    legs = [(walk, leg) for walk in walks for leg in range(len(walk.slides))]
    flanks = [_match_touchdowns_and_lift_offs(walk, leg) for walk, leg in legs]
    slips = [_match_slip_reports(walk, leg) for walk, leg in legs]
    downs = np.array([row for one in flanks for row in one.touchdown_timings_ms])
    ups = np.array([row for one in flanks for row in one.lift_off_timings_ms])
    slide_distances_mm = np.array([way for one in slips for way in one.slides_before_report_mm])
    down_ms, up_ms = downs[downs[:, 0] < _MAX_SCORED_REPORT_DELAY_MS], ups[np.isfinite(ups[:, 0])]
    frictions, normals_deg, stands, contacts = [], [], [], []
    for walk in walks:
        ratio, pressing_n = _friction_ratio_and_normal_force(walk.true_force_n, walk.true_normal)
        later = walk.t_s > WARM_UP_S
        frictions.append(
            (walk.tangential_over_normal - ratio)[(pressing_n > MIN_FRICTION_FORCE_N) & later[:, None]]
        )
        firm = (pressing_n > MIN_NORMAL_FORCE_N) & np.isfinite(walk.estimated_normal[..., 0])
        normals_deg.append(angles_between_deg(walk.estimated_normal[firm], walk.true_normal[firm]))
        stands.append(np.stack([slides.stance_number[later] >= 0 for slides in walk.slides], axis=1))
        contacts.append(walk.debounced_contact[later] > 0.0)
    stand = np.concatenate(stands)
    hours = float(stand.size * np.diff(walks[0].t_s).mean()) / 3600.0
    last = [
        walk.estimated_friction_coefficient[-1]
        - np.nanmean([slides.kinetic_friction for slides in walk.slides])
        for walk in walks
    ]
    reported_mm = slide_distances_mm[np.isfinite(slide_distances_mm)]
    return Results(
        leg_hours=hours,
        swing_hours=hours * float((~stand).mean()),
        n_touchdowns=len(downs),
        touchdown_delay_p50_ms=float(np.percentile(downs[:, 0], 50, method="nearest")),
        touchdown_delay_p95_ms=float(np.percentile(downs[:, 0], 95, method="nearest")),
        missed_touchdown_share=float(np.isinf(downs[:, 0]).mean()),
        n_false_touchdowns=sum(one.n_false_touchdowns for one in flanks),
        touchdown_time_error_rms_ms=_rms(down_ms[:, 1]),
        touchdown_time_error_rms_sigmas=_rms(down_ms[:, 1] / down_ms[:, 2]),
        n_reported_lift_offs=len(up_ms),
        lift_off_time_error_rms_ms=_rms(up_ms[:, 1]),
        contact_correct_share=float((np.concatenate(contacts) == stand).mean()),
        mean_abs_tangential_over_normal_error=float(np.nanmean(np.abs(np.concatenate(frictions)))),
        mean_contact_normal_error_deg=float(np.concatenate(normals_deg).mean()),
        n_slides_with_unknown_force=sum(one.n_slides_with_unknown_force for one in slips),
        n_reportable_slides=len(slide_distances_mm),
        mean_slide_before_report_mm=float(reported_mm.mean()) if len(reported_mm) else float("nan"),
        slide_before_report_p95_mm=float(np.percentile(reported_mm, 95))
        if len(reported_mm)
        else float("nan"),
        missed_slide_share=float(np.isinf(slide_distances_mm).mean())
        if len(slide_distances_mm)
        else float("nan"),
        n_false_slips=sum(one.n_false_slips for one in slips),
        n_slip_reports_without_slide=sum(one.n_slip_reports_without_slide for one in slips),
        friction_coefficient_error_rms=_rms(np.array(last)),
    ), {}


def _rms(errors: Vector) -> float:
    """Return the root mean square of the errors."""
    return float(np.sqrt(np.nanmean(errors**2)))


STUDY = Study(name="gait-semantics", title="What a gait controller is told", compute=compute)
