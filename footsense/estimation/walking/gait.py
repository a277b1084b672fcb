"""Gait estimate of all legs, updated with every conversion: contact events, load share, ground normal, friction, slip.

Contact and its thresholds are those of `contact.py`, ground and slip those of `ground.py`. Slip is looked for on half
of the legs in turn, and what changes slowly is computed for the published frames alone.
"""

import math
from collections import deque
from collections.abc import Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np

from footsense.estimation.settings import LONG_SILENCE_NS, SLOW_PERIOD_NS
from footsense.estimation.walking.contact import ContactDetector
from footsense.estimation.walking.ground import NO_GROUND, SLIP_LAG_NS, SlipDetector, ground_of
from footsense.frames import GaitEvent, GaitEventKind, GaitFrame, Slip
from footsense.ports import LoadEstimate

#: State of a leg whose force is known and whose foot is in contact.
_FORCE_KNOWN_IN_CONTACT = (True, True)

#: Slips are looked for on half of the legs in turn: the next conversion has mostly the same readings.
_CONVERSIONS_PER_CHECK = 2
#: Share of the load at the touchdown [1] whose passing dates it, and the loads among which it is looked for.
_PASSED_LOAD_REL, _N_SEARCHED_LOADS = 0.3, 24
#: Conversions that are kept.
N_BUFFERED_CONVERSIONS = 1 + _N_SEARCHED_LOADS


class EventLags(NamedTuple):
    """Times from events to their detection.

    Attributes:
        touch_s: From a touchdown to the contact [s], besides the part that its rise tells; its spread is a third of it.
            From the end of a load to the end of the contact it is twice that.
        rise_rel: That part, over the time since the load passed a share of what it is at the contact [1].
    """

    touch_s: float
    rise_rel: float


#: Of slow and of fast scans (`EstimationLimits.is_fast_scan`). Fitted to the touches of the walkers' training and
#: selection, without hops and landings.
SLOW_SCAN_LAGS, FAST_SCAN_LAGS = EventLags(12.6e-3, 0.62), EventLags(6.25e-3, 0.93)
#: Spread of the part that a rise tells [1], and of the time from the end of a load to that of the contact [s].
_RISE_SIGMA_REL, _FALL_SIGMA_S = 0.3, 5.5e-3


class BackDated(NamedTuple):
    """Back-dated time of an event [ns], and its standard deviation [s]."""

    t_ns: int
    sigma_s: float


class LegLoads(NamedTuple):
    """Loads of all legs after one conversion, each the mean of a scan above the leg's load in swing.

    Attributes:
        t_ns: Time at which they were known [ns].
        load_n: Loads [N]; NaN if unknown.
    """

    t_ns: int
    load_n: list[float]


def touchdown(loads: Sequence[LegLoads], row: int, lags: EventLags = SLOW_SCAN_LAGS) -> BackDated:
    """Return the back-dated time of a touchdown, for a leg whose load has just exceeded the threshold.

    Loads rise from nothing with a small slope: the time since two loads in a row were below three tenths of what it is
    now tells how fast it rises. The mean of a scan tells it better than the estimate for the time, which rings.

    Args:
        loads: Last loads, oldest first.
        row: Row of the leg.
        lags: Usual lags.

    Returns:
        A time within the searched loads and the usual lag before; only the lag before, where a prediction made the
        contact, and the mean does not show it yet.
    """
    t_ns = later_ns = loads[-1].t_ns
    later_n = loads[-1].load_n[row]
    passed_n = _PASSED_LOAD_REL * later_n
    below: LegLoads | None = None
    for past in islice(reversed(loads), 1, 1 + _N_SEARCHED_LOADS):
        past_n = past.load_n[row]
        if not (later_n > 0.0 and math.isfinite(past_n)):
            break
        if past_n >= passed_n:
            later_ns, later_n, below = past.t_ns, past_n, None
        elif below is None:
            below = past  # one alone may be of a row that feels little
        else:
            break
    if below is not None:
        below_n = below.load_n[row]
        later_ns -= round((later_ns - below.t_ns) * (later_n - passed_n) / (later_n - below_n))
    since_s = (t_ns - later_ns) * 1e-9
    back_s = lags.touch_s + lags.rise_rel * since_s
    return BackDated(t_ns - round(back_s * 1e9), math.hypot(lags.touch_s / 3.0, _RISE_SIGMA_REL * since_s))


def lift_off(t_ns: int, lags: EventLags) -> BackDated:
    """Return the back-dated time of a lift-off that is told now [ns].

    The same time before, whatever the load did: a line through its fall spreads more.
    """
    return BackDated(t_ns - round(2.0 * lags.touch_s * 1e9), _FALL_SIGMA_S)


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
        lags: EventLags = SLOW_SCAN_LAGS,
        period_ns: int = SLOW_PERIOD_NS,
    ) -> None:
        self._lags = lags
        self._friction = friction
        self._slips = [SlipDetector(friction) for _ in range(n_legs)]
        self._tells_slips = math.isfinite(friction)
        self._loads: deque[LegLoads] = deque(maxlen=N_BUFFERED_CONVERSIONS)
        self._turn = 0
        self._period_ns, self._due_ns = period_ns, 0
        # Whether the force is known, and whether the foot is in contact, of each leg.
        self._states = [(False, False)] * n_legs
        # Contact of each leg when its force was last known, and when that was; None: not known for long.
        self._told: list[bool | None] = [None] * n_legs
        self._known_ns = [0] * n_legs
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
        for force_n, contact, told in zip(load.force_n[:, 2].tolist(), contacts, self._told, strict=True):
            swing_load_n = contact.swing_load_n
            above_n.append(force_n - swing_load_n)
            mean_n.append(contact.load_n - swing_load_n)
            # One that began without a known force begins here with a load that is known.
            in_contact = contact.in_contact and (contact.raw or told is not False)
            states.append((math.isfinite(force_n + contact.load_n), in_contact))
        self._loads.append(LegLoads(now_ns, mean_n))
        events: list[GaitEvent] = []
        if states != self._states:
            for row, (before, now) in enumerate(zip(self._states, states, strict=True)):
                if now != before:
                    events += self._contact_events(row, before, now)
            self._states = states
        self._turn = (self._turn + 1) % _CONVERSIONS_PER_CHECK
        for row in range(self._turn, len(states), _CONVERSIONS_PER_CHECK) if self._tells_slips else ():
            if states[row] == _FORCE_KNOWN_IN_CONTACT:
                t_ns = self._slips[row].observe(ground_of(load, row), now_ns)
                if t_ns is not None:
                    starts = self._slips[row].state is Slip.SLIPPING
                    kind = GaitEventKind.SLIP if starts else GaitEventKind.SLIP_END
                    events.append(GaitEvent(kind, row, t_ns, 1e-9 * SLIP_LAG_NS))
        if not events and now_ns < self._due_ns:
            return None
        if now_ns >= self._due_ns and self._period_ns:
            self._due_ns = (now_ns // self._period_ns + 1) * self._period_ns
        return self._gait_frame(load, contacts, above_n, now_ns, tuple(events))

    def _contact_events(self, row: int, before: tuple[bool, bool], now: tuple[bool, bool]) -> list[GaitEvent]:
        is_known, in_contact = now
        slip = self._slips[row]
        was_slipping = slip.state is Slip.SLIPPING
        if now != _FORCE_KNOWN_IN_CONTACT:
            slip.reset_stance()
        now_ns = self._loads[-1].t_ns
        if before[0]:
            self._known_ns[row] = now_ns
        if not is_known:
            return []
        # A contact that began or ended while the force was not known for long has no event, and no time.
        unknown_ns, told = now_ns - self._known_ns[row], self._told[row]
        self._told[row] = in_contact
        if told is None or unknown_ns > LONG_SILENCE_NS:
            self._touchdowns[row] = self._lift_offs[row] = _NO_TIME
            return []
        if told is in_contact:
            return []
        if in_contact:
            kinds, dated = [GaitEventKind.TOUCHDOWN], touchdown(self._loads, row, self._lags)
            own, other = self._touchdowns, self._lift_offs
        else:
            kinds, dated = [GaitEventKind.LIFT_OFF], lift_off(now_ns, self._lags)
            own, other = self._lift_offs, self._touchdowns
            if was_slipping:
                kinds.insert(0, GaitEventKind.SLIP_END)
        # A foot cannot touch before it was lifted, nor be lifted before it touched.
        own[row] = BackDated(
            max(dated.t_ns, other[row].t_ns + 1), math.hypot(dated.sigma_s, 0.5 * 1e-9 * unknown_ns)
        )
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
    return 0.5 + 0.5 * math.erf(sigmas / math.sqrt(2.0))
