"""How right the service's forces, contacts, times, and slips are on the feet of walking robots."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from footsense.foot.directions import angles_between_deg
from footsense.frames import IS_USABLE_STATE, GaitEventKind, Mask, State, Vector
from footsense.lab.evaluation.walker_runs import LEAD_IN_S, WalkerOutputs

#: Time after the lead-in in which nothing counts: the robot comes to stand, and swings show their noise [s].
WARM_UP_S = 1.0
#: Over the peak of a run [1]: normal force of a touch's first load, and force from which directions count.
FIRST_LOAD_REL, LOADED_REL = 0.01, 0.1
#: Gaps between loads that are one touch, and shortest touch and swing before it that count [s].
_MERGED_S, MIN_TOUCH_S = 0.025, 0.03
#: Time after a touch and before its end that are not mid-stance [s].
AFTER_TOUCH_S, BEFORE_END_S = 0.04, 0.03
#: Time after a touch within which a report belongs to it [s].
REPORT_AFTER_S = 0.08
#: Sliding: speed of the contact point [m/s] and normal force over the peak [1] from which a foot slides; way of a slide
#: that counts [m], and time within which a slip belongs to a slide [s].
SLIDE_M_S, _SLIDE_LOAD_REL, SLIDE_M, _SLIP_WITHIN_S = 0.02, 0.05, 5e-3, 0.06
#: Ratio over the ground's coefficient from which a foot is at its cone, where it slides at any speed [1].
AT_CONE_REL = 0.98
#: Bounds of the probability of holding within which a foot's share of holding is compared with it [1].
HOLDS_BOUNDS = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


class Touch(NamedTuple):
    """One touch of a leg: first load and end [s], and whether the leg was in the air long enough before it."""

    start_s: float
    end_s: float
    counts: bool


def touches(outputs: WalkerOutputs, leg: int, peak_n: float) -> list[Touch]:
    """Return the touches of a leg that last, after the warm-up, by the truth."""
    t_s = outputs.all_loads.t_s
    pressing_n = (outputs.all_loads.force_n[:, leg] * outputs.all_loads.normal[:, leg]).sum(axis=1)
    spans: list[list[float]] = []
    for first, last in _spans(pressing_n > FIRST_LOAD_REL * peak_n):
        start_s, end_s = float(t_s[first]), float(t_s[min(last, len(t_s) - 1)])
        if spans and start_s - spans[-1][1] < _MERGED_S:
            spans[-1][1] = end_s
        else:
            spans.append([start_s, end_s])
    found, before_s = [], -np.inf
    for start_s, end_s in spans:
        swung = start_s - before_s > MIN_TOUCH_S
        in_time = start_s > LEAD_IN_S + WARM_UP_S and end_s + REPORT_AFTER_S < outputs.t_s[-1]
        found.append(Touch(start_s, end_s, bool(swung and in_time and end_s - start_s > MIN_TOUCH_S)))
        before_s = end_s
    return found


def _spans(mask: Mask) -> Iterator[tuple[int, int]]:
    """Return where a mask is set on end: first row, and the one after the last."""
    edges = np.flatnonzero(np.diff(mask.astype(int), prepend=0, append=0)).tolist()
    return zip(edges[::2], edges[1::2], strict=True)


def force_scores(outputs: WalkerOutputs, peak_n: float) -> dict[str, Any]:
    """Return the errors of the forces of a run: direction [deg], share without a force, coverage of sigma."""
    truth, t_s = outputs.true.force_n, outputs.t_s
    size_n = np.linalg.norm(truth, axis=2)
    counted = (t_s > LEAD_IN_S + WARM_UP_S)[:, None]
    loaded = (size_n > LOADED_REL * peak_n) & counted
    usable = IS_USABLE_STATE[outputs.state]
    since_s, before_s = _times_in_touch(outputs, peak_n)
    angle_deg = np.full(size_n.shape, np.nan)
    both = loaded & usable
    angle_deg[both] = angles_between_deg(outputs.force_n[both], truth[both])
    middle = (since_s > AFTER_TOUCH_S) & (before_s > BEFORE_END_S)
    error_n = outputs.force_n - truth
    off = np.abs(error_n / outputs.sigma_n)
    used = usable & counted
    return {
        "direction_deg": _mean(angle_deg[loaded]),
        "direction_p95_deg": _percentile(angle_deg[loaded], 95.0),
        "mid_stance_deg": _mean(angle_deg[loaded & middle]),
        "no_force_share": _share(~usable[loaded]),
        "overload_share": _share((outputs.state == State.DEGRADED)[loaded]),
        "within_2_sigma": _share(off[used] < 2.0),
        "beyond_5_sigma": _share(off[used] > 5.0),
        "sigma_over_error": {
            phase: float(
                np.sqrt(np.mean(outputs.sigma_n[used & told] ** 2) / np.mean(error_n[used & told] ** 2))
            )
            if (used & told).any()
            else np.nan
            for phase, told in (("air", ~outputs.contact), ("contact", outputs.contact))
        },
        "n_off_by_peak": int((np.linalg.norm(error_n[used], axis=1) > peak_n).sum()),
    }


def _times_in_touch(outputs: WalkerOutputs, peak_n: float) -> tuple[Vector, Vector]:
    """Return the time since the start and until the end of each leg's touch [s], shape (n, legs); NaN in the air."""
    since_s, before_s = np.full((2, *outputs.state.shape), np.nan)
    for leg in range(outputs.state.shape[1]):
        for touch in touches(outputs, leg, peak_n):
            rows = (outputs.t_s >= touch.start_s) & (outputs.t_s < touch.end_s)
            since_s[rows, leg] = outputs.t_s[rows] - touch.start_s
            before_s[rows, leg] = touch.end_s - outputs.t_s[rows]
    return since_s, before_s


def contact_scores(
    outputs: WalkerOutputs, peak_n: float, report_after_s: float = REPORT_AFTER_S
) -> dict[str, Any]:
    """Return what became of each touch of a run, and touchdowns in the air.

    Args:
        outputs: The run.
        peak_n: Peak of its loads [N].
        report_after_s: Time after a touch within which a report is one of it [s].
    """
    delays_ms, errors_ms, sigmas_ms, lifts_ms = [], [], [], []
    n_touches = n_missed = n_twice = n_air = 0
    touching = np.zeros_like(outputs.contact)
    for leg in range(outputs.state.shape[1]):
        every = touches(outputs, leg, peak_n)
        for touch in every:
            touching[(outputs.t_s >= touch.start_s) & (outputs.t_s < touch.end_s), leg] = True
        reports = [(float(outputs.t_s[row]), event) for row, event in outputs.events if event.leg == leg]
        down = [one for one in reports if one[1].kind is GaitEventKind.TOUCHDOWN]
        up = [one for one in reports if one[1].kind is GaitEventKind.LIFT_OFF]
        for sent_s, _ in down:
            late = sent_s > LEAD_IN_S + WARM_UP_S
            # Of any touch, however short: the sensor's first scan after it included.
            n_air += late and not any(
                touch.start_s - 1e-3 <= sent_s < touch.end_s + _MERGED_S for touch in every
            )
        for touch, after_s in zip(every, [*(one.start_s for one in every[1:]), np.inf], strict=True):
            if not touch.counts:
                continue
            n_touches += 1
            inside = [one for one in down if touch.start_s <= one[0] < touch.end_s]
            n_twice += len(inside) > 1
            own = [one for one in inside if one[0] < touch.start_s + report_after_s]
            n_missed += not own
            if own:
                sent_s, event = own[0]
                delays_ms.append(1e3 * (sent_s - touch.start_s))
                errors_ms.append(1e3 * (1e-9 * event.t_ns - touch.start_s))
                sigmas_ms.append(1e3 * event.sigma_s)
                ends = [one for one in up if sent_s < one[0] < after_s]
                lifts_ms.append(1e3 * (ends[-1][0] - touch.end_s) if ends else np.inf)
    judged = outputs.t_s > LEAD_IN_S + WARM_UP_S
    return {
        "n_touches": n_touches,
        "n_missed": n_missed,
        "n_twice": n_twice,
        "n_in_air": int(n_air),
        "wrong_share": _share((outputs.contact != touching)[judged]),
        "delays_ms": delays_ms,
        "errors_ms": errors_ms,
        "sigmas_ms": sigmas_ms,
        "lift_off_delays_ms": lifts_ms,
    }


class Slide(NamedTuple):
    """One slide of a foot: start [s], end [s] and way [m]."""

    start_s: float
    end_s: float
    way_m: float


def _slides(outputs: WalkerOutputs, leg: int, peak_n: float, sliding: Mask) -> list[Slide]:
    """Return the slides of a leg within its touches, of any way, after the warm-up.

    Args:
        outputs: The run.
        leg: The leg.
        peak_n: Peak of its loads [N].
        sliding: Where the foot slides, shape (n,).
    """
    t_s, speed_m_s = outputs.t_s, np.linalg.norm(outputs.true.slip_m_s[:, leg], axis=1)
    step_s, found = float(t_s[1] - t_s[0]), []
    for touch in touches(outputs, leg, peak_n):
        rows = np.flatnonzero((t_s >= touch.start_s) & (t_s < touch.end_s))
        for first, last in _spans(sliding[rows]):
            start_s = float(t_s[rows[first]])
            if start_s > LEAD_IN_S + WARM_UP_S:
                way_m = float(speed_m_s[rows[first:last]].sum() * step_s)
                found.append(Slide(start_s, start_s + (last - first) * step_s, way_m))
    return found


def _sliding(outputs: WalkerOutputs, leg: int, peak_n: float) -> tuple[Mask, Mask, Mask]:
    """Return where a leg carries, slides fast enough to count, and is at its cone, by the truth, each of shape (n,)."""
    force_n, normal = outputs.true.force_n[:, leg], outputs.true.normal[:, leg]
    pressing_n = (force_n * normal).sum(axis=1)
    tangential_n = np.linalg.norm(force_n - pressing_n[:, None] * normal, axis=1)
    carries = pressing_n > _SLIDE_LOAD_REL * peak_n
    fast = carries & (np.linalg.norm(outputs.true.slip_m_s[:, leg], axis=1) > SLIDE_M_S)
    return carries, fast, carries & (tangential_n > AT_CONE_REL * outputs.true.friction * pressing_n)


def slip_scores(outputs: WalkerOutputs, peak_n: float) -> dict[str, Any]:
    """Return which slides of a run were told, which slips are none, and how right the probability of holding is.

    A slide is found by a slip that is told as it begins or soon after, and by one that was told before and is not over.
    A slip is false if the foot neither slides nor is at its cone as it is told.
    """
    found: dict[str, Any] = {
        "walked_s": float(outputs.t_s[-1] - LEAD_IN_S - WARM_UP_S),
        "holds_bins": np.zeros((len(HOLDS_BOUNDS) - 1, 2), int).tolist(),
    }
    n_legs = outputs.state.shape[1]
    truth = [_sliding(outputs, leg, peak_n) for leg in range(n_legs)]
    fast = [_slides(outputs, leg, peak_n, truth[leg][1]) for leg in range(n_legs)]
    any_speed = [_slides(outputs, leg, peak_n, truth[leg][1] | truth[leg][2]) for leg in range(n_legs)]
    found |= _counted_slips(outputs, fast, any_speed)
    for leg, (carries, slides, at_cone) in enumerate(truth):
        known = carries & outputs.contact[:, leg] & np.isfinite(outputs.holds[:, leg])
        known &= outputs.t_s > LEAD_IN_S + WARM_UP_S
        bins = np.searchsorted(HOLDS_BOUNDS[1:-1], outputs.holds[known, leg], "right")
        for number, holds in zip(bins.tolist(), (~(slides | at_cone))[known].tolist(), strict=True):
            found["holds_bins"][number][0] += 1
            found["holds_bins"][number][1] += holds
    return found


def _counted_slips(
    outputs: WalkerOutputs,
    fast: Sequence[Sequence[Slide]],
    any_speed: Sequence[Sequence[Slide]],
) -> dict[str, Any]:
    """Return the counts of slips and slides of all legs, from their slides above a speed and of any speed."""
    n_slips = n_false = n_slow = n_slides = n_found = 0
    delays_ms = []

    def within(at_s: float, slides: Sequence[Slide]) -> bool:
        return any(one.start_s - 5e-3 <= at_s < one.end_s + _SLIP_WITHIN_S for one in slides)

    for leg in range(len(fast)):
        told_s, ends_s = (
            [
                float(outputs.t_s[row])
                for row, event in outputs.events
                if event.leg == leg and event.kind is kind
            ]
            for kind in (GaitEventKind.SLIP, GaitEventKind.SLIP_END)
        )
        sent_s = [at_s for at_s in told_s if at_s > LEAD_IN_S + WARM_UP_S]
        over_s = [min((end_s for end_s in ends_s if end_s > at_s), default=np.inf) for at_s in sent_s]
        n_slips += len(sent_s)
        n_false += sum(not within(at_s, any_speed[leg]) for at_s in sent_s)
        n_slow += sum(not within(at_s, fast[leg]) for at_s in sent_s)
        for one in fast[leg]:
            if one.way_m < SLIDE_M:
                continue
            own = [
                at_s
                for at_s, end_s in zip(sent_s, over_s, strict=True)
                if at_s < one.end_s + _SLIP_WITHIN_S and end_s > one.start_s
            ]
            n_slides += 1
            n_found += bool(own)
            if own:
                delays_ms.append(1e3 * max(own[0] - one.start_s, 0.0))
    return {
        "n_slips": n_slips,
        "n_false_slips": n_false,
        "n_slow_slips": n_slow,
        "n_slides": n_slides,
        "n_slides_found": n_found,
        "slip_delays_ms": delays_ms,
    }


def scores(outputs: WalkerOutputs, peak_n: float, report_after_s: float = REPORT_AFTER_S) -> dict[str, Any]:
    """Return all scores of a run whose loads peak at a force [N]; the last argument as of `contact_scores`."""
    return {
        **force_scores(outputs, peak_n),
        **contact_scores(outputs, peak_n, report_after_s),
        **slip_scores(outputs, peak_n),
    }


def _mean(values: Vector) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def _percentile(values: Vector, share: float) -> float:
    known = values[~np.isnan(values)]
    return float(np.percentile(known, share, method="nearest")) if known.size else float("nan")


def _share(mask: Mask) -> float:
    return float(mask.mean()) if mask.size else float("nan")
