"""Gait estimate of all legs, updated with every conversion: contact events, load share, ground normal, friction, slip.

Contact and its thresholds are those of `contact.py`, ground and slip those of `ground.py`. Slip is looked for on half
of the legs in turn, and what changes slowly is computed for the published frames alone.
"""

import math
from collections import deque
from collections.abc import Sequence
from itertools import islice
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from footsense.estimation.walking.contact import ContactDetector
from footsense.estimation.walking.ground import NO_GROUND, SlipDetector, ground_of
from footsense.frames import GaitEvent, GaitEventKind, GaitFrame, Slip
from footsense.ports import LoadEstimate

#: Period of the frames without an event [ns].
GAIT_FRAME_PERIOD_NS = 100_000_000
#: Largest exponent of the probability: 1 - 1e-6.
_MAX_EXPONENT = 13.8
#: Slope of a logistic function over that of a normal distribution [1].
_LOGISTIC_SLOPE = 1.7
#: State of a leg whose force is known and whose foot is in contact.
_FORCE_KNOWN_IN_CONTACT = (True, True)

#: Slips are looked for on half of the legs in turn: the next conversion has mostly the same readings.
_CONVERSIONS_PER_CHECK = 2
#: Share of the load at the touchdown [1] whose passing dates it, and the loads among which it is looked for.
_PASSED_LOAD_REL, _N_SEARCHED_LOADS = 0.4, 12
#: Time from the touchdown to the contact, over the time since that passing [1], and its spread.
_SINCE_REL, _SINCE_SIGMA_REL = 0.7, 0.4
#: Conversions that are kept.
N_BUFFERED_CONVERSIONS = 1 + _N_SEARCHED_LOADS
#: Standard deviation of the time of a slip [s].
_SLIP_TIME_SIGMA_S = 0.01


class EventLags(NamedTuple):
    """Times from events to their detection, and their spread.

    Attributes:
        touch_s: From a touchdown to the contact [s], besides the part that its rise tells.
        touch_sigma_s: Spread of that [s].
        fall_s: From the end of a load to the end of the contact [s].
        fall_sigma_s: Spread of that [s].
    """

    touch_s: float
    touch_sigma_s: float
    fall_s: float
    fall_sigma_s: float


#: Of scans of single elements and of rows. Fitted to the touches of the walkers' selection, without hops and landings.
ELEMENTS_LAGS = EventLags(8.7e-3, 3.0e-3, 24e-3, 5.5e-3)
ROWS_LAGS = EventLags(5.7e-3, 1.7e-3, 13e-3, 5.5e-3)


class BackDated(NamedTuple):
    """Back-dated time of an event [ns], and its standard deviation [s]."""

    t_ns: int
    sigma_s: float


class LegLoads(NamedTuple):
    """Estimated loads of all legs after one conversion, each relative to the leg's load in swing; NaN if unknown.

    Attributes:
        t_ns: Time of the estimate [ns].
        load_n: Loads as estimated for that time [N].
        scan_mean_n: Loads that are means of a scan [N].
    """

    t_ns: int
    load_n: list[float]
    scan_mean_n: list[float]


_load_of, _scan_mean_of = attrgetter("load_n"), attrgetter("scan_mean_n")


def touchdown(loads: Sequence[LegLoads], row: int, lags: EventLags = ELEMENTS_LAGS) -> BackDated:
    """Return the back-dated time of a touchdown, for a leg whose load has just exceeded the threshold.

    Loads rise from nothing with a small slope: the time at which the load passed two fifths of what it is now tells how
    fast it rises. Where the estimate for the time does not show the load yet, the mean of the scan does.

    Args:
        loads: Last loads, oldest first.
        row: Row of the leg.
        lags: Usual lags.

    Returns:
        A time within the searched loads and the usual lag before.
    """
    newest = loads[-1]
    t_ns = newest.t_ns
    of_leg = _load_of if newest.load_n[row] > 0.0 else _scan_mean_of
    later_ns, later_n = t_ns, of_leg(newest)[row]
    passed_n = _PASSED_LOAD_REL * later_n if later_n > 0.0 else -math.inf
    for past in islice(reversed(loads), 1, 1 + _N_SEARCHED_LOADS):
        past_n = of_leg(past)[row]
        if math.isnan(past_n):
            break
        if past_n < passed_n:
            later_ns -= round((later_ns - past.t_ns) * (later_n - passed_n) / (later_n - past_n))
            break
        later_ns, later_n = past.t_ns, past_n
    since_s = (t_ns - later_ns) * 1e-9
    back_s = lags.touch_s + _SINCE_REL * since_s
    return BackDated(t_ns - round(back_s * 1e9), math.hypot(lags.touch_sigma_s, _SINCE_SIGMA_REL * since_s))


def lift_off(t_ns: int, lags: EventLags) -> BackDated:
    """Return the back-dated time of a lift-off that is told now [ns].

    The same time before, whatever the load did: a line through its fall spreads more.
    """
    return BackDated(t_ns - round(lags.fall_s * 1e9), lags.fall_sigma_s)


_NO_TIME = BackDated(0, math.nan)


class GaitTracker:
    """Gait estimator of all legs: contact events, load share, ground normal, friction, slip.

    Args:
        n_legs: Legs of a frame.
        friction: Coefficient of friction of the ground [1]; NaN where it is not known.
        lags: Usual lags of its events.
        period_ns: Period of the frames without an event [ns]; 0 for a frame of each conversion.
    """

    def __init__(
        self,
        n_legs: int,
        friction: float = math.nan,
        lags: EventLags = ELEMENTS_LAGS,
        period_ns: int = GAIT_FRAME_PERIOD_NS,
    ) -> None:
        self._lags = lags
        self._friction = friction
        self._slips = [SlipDetector(friction) for _ in range(n_legs)]
        self._loads: deque[LegLoads] = deque(maxlen=N_BUFFERED_CONVERSIONS)
        self._turn = 0
        self._period_ns, self._due_ns = period_ns, 0
        # Whether the force is known, and whether the foot is in contact, of each leg.
        self._states = [(False, False)] * n_legs
        self._touchdowns, self._lift_offs = [_NO_TIME] * n_legs, [_NO_TIME] * n_legs

    def observe(
        self, load: LoadEstimate, contacts: Sequence[ContactDetector], now_ns: int
    ) -> GaitFrame | None:
        """Process the loads of one conversion; return the gait if an event occurred or a frame is due, else None.

        Args:
            load: Loads of all legs as of `now_ns`; NaN forces where they may not be used.
            contacts: Contact of each leg, as of the same readings.
            now_ns: Current time [ns].
        """
        above_n, mean_n, states = [], [], []
        for force_n, contact in zip(load.force_n[:, 2].tolist(), contacts, strict=True):
            swing_load_n = contact.swing_load_n
            above_n.append(force_n - swing_load_n)
            mean_n.append(contact.load_n - swing_load_n)
            states.append((math.isfinite(force_n + contact.load_n), contact.in_contact))
        self._loads.append(LegLoads(now_ns, above_n, mean_n))
        events: list[GaitEvent] = []
        if states != self._states:
            for row, (before, now) in enumerate(zip(self._states, states, strict=True)):
                if now != before:
                    events += self._contact_events(row, before, now)
            self._states = states
        self._turn = (self._turn + 1) % _CONVERSIONS_PER_CHECK
        for row in range(self._turn, len(states), _CONVERSIONS_PER_CHECK):
            if states[row] == _FORCE_KNOWN_IN_CONTACT:
                t_ns = self._slips[row].observe(ground_of(load, row), now_ns)
                if t_ns is not None:
                    starts = self._slips[row].state is Slip.SLIPPING
                    kind = GaitEventKind.SLIP if starts else GaitEventKind.SLIP_END
                    events.append(GaitEvent(kind, row, t_ns, _SLIP_TIME_SIGMA_S))
        if not events and now_ns < self._due_ns:
            return None
        if now_ns >= self._due_ns and self._period_ns:
            self._due_ns = (now_ns // self._period_ns + 1) * self._period_ns
        return self._gait_frame(load, contacts, above_n, now_ns, tuple(events))

    def _contact_events(self, row: int, before: tuple[bool, bool], now: tuple[bool, bool]) -> list[GaitEvent]:
        # A contact that began or ended while the force was not known has no event, and no time.
        is_known, in_contact = now
        slip = self._slips[row]
        was_slipping = slip.state is Slip.SLIPPING
        if not (is_known and in_contact):
            slip.reset_stance()
        if before == (True, in_contact):
            return []
        if not (is_known and before[0]):
            if before[1] != in_contact:
                self._touchdowns[row] = self._lift_offs[row] = _NO_TIME
            return []
        if in_contact:
            kinds, dated = [GaitEventKind.TOUCHDOWN], touchdown(self._loads, row, self._lags)
            own, other = self._touchdowns, self._lift_offs
        else:
            kinds, dated = [GaitEventKind.LIFT_OFF], lift_off(self._loads[-1].t_ns, self._lags)
            own, other = self._lift_offs, self._touchdowns
            if was_slipping:
                kinds.insert(0, GaitEventKind.SLIP_END)
        # A foot cannot touch before it was lifted, nor be lifted before it touched.
        own[row] = BackDated(max(dated.t_ns, other[row].t_ns + 1), dated.sigma_s)
        return [GaitEvent(kind, row, *own[row]) for kind in kinds]

    def _gait_frame(
        self,
        load: LoadEstimate,
        contacts: Sequence[ContactDetector],
        above_n: list[float],
        now_ns: int,
        events: tuple[GaitEvent, ...],
    ) -> GaitFrame:
        known, contact = np.array(self._states, np.bool_).T
        pressing_n = np.where(contact, np.maximum(load.force_n[:, 2], 0.0), 0.0)
        total_n = float(pressing_n[known].sum())
        grounds = [
            ground_of(load, row) if state == _FORCE_KNOWN_IN_CONTACT else NO_GROUND
            for row, state in enumerate(self._states)
        ]
        _, normal, normal_sigma_rad, ratio, ratio_sigma = map(np.array, zip(*grounds, strict=True))
        touchdown_ns, touchdown_sigma_s = zip(*self._touchdowns, strict=True)
        lift_off_ns, lift_off_sigma_s = zip(*self._lift_offs, strict=True)
        return GaitFrame(
            t_ns=now_ns,
            contact=contact,
            contact_raw=np.array([leg.raw for leg in contacts]),
            probability=np.array([_contact_probability(*leg) for leg in zip(contacts, above_n, strict=True)]),
            touchdown_ns=np.array(touchdown_ns, np.int64),
            touchdown_sigma_s=np.array(touchdown_sigma_s),
            lift_off_ns=np.array(lift_off_ns, np.int64),
            lift_off_sigma_s=np.array(lift_off_sigma_s),
            load_share=np.where(known, pressing_n, np.nan) / (total_n or math.nan),
            normal=normal,
            normal_sigma_rad=normal_sigma_rad,
            tangential_over_normal=ratio,
            tangential_over_normal_sigma=ratio_sigma,
            slip=np.array([slip.state for slip in self._slips], np.uint8),
            friction=self._friction,
            all_in_air=bool((known & ~contact).all()),
            events=events,
        )


def _contact_probability(contact: ContactDetector, above_n: float) -> float:
    """Return the probability of contact, from the load's distance to the threshold; NaN if unknown."""
    measured_n = contact.load_n - contact.swing_load_n - contact.touch_n
    measured = measured_n / contact.noise.sigma_n
    estimated = (above_n - contact.predicted_touch_n) / contact.predicted_noise.sigma_n
    if not math.isfinite(measured + estimated):
        return math.nan
    sigmas = max(measured, estimated)
    return 1.0 / (1.0 + math.exp(-min(max(_LOGISTIC_SLOPE * sigmas, -_MAX_EXPONENT), _MAX_EXPONENT)))
