"""Gait estimate of all legs, updated with every conversion: contact events, load share, ground normal, friction, slip.

Contact and its times are those of `contact.py`, the ground that of `ground.py`, and whether a foot stands still that of
`holds.py`, of which slips follow. Ratios are looked at on half of the legs in turn, and what changes slowly is computed
for the published frames alone.
"""

import math
from collections.abc import Sequence

import numpy as np

from footsense.estimation.settings import LONG_SILENCE_NS, SLOW_PERIOD_NS
from footsense.estimation.walking.contact import NO_TIME, BackDated, ContactDetector
from footsense.estimation.walking.ground import NO_GROUND, foot_loads, friction_ratio, ground_of
from footsense.estimation.walking.holds import SAME_ERROR_S, GroundFriction, Holding, ratio_sigma
from footsense.frames import GaitEvent, GaitEventKind, GaitFrame, Slip
from footsense.ports import LoadEstimate

#: State of a leg whose force is known and whose foot is in contact.
_FORCE_KNOWN_IN_CONTACT = (True, True)

#: Ratios are looked at on half of the legs in turn: the next conversion has mostly the same readings.
_CONVERSIONS_PER_CHECK = 2
#: From the begin of a slip, or its end, to an estimate that shows it, and the standard deviation of that [ns].
_SLIP_LAG_NS = round(1e9 * SAME_ERROR_S)


class GaitTracker:
    """Gait estimator of all legs: contact events, load share, ground normal, friction, slip.

    Args:
        n_legs: Legs of a frame.
        friction: Coefficient of friction of the ground [1]; NaN where it is not known.
        period_ns: Period of the frames without an event [ns]; 0 for a frame of each conversion.

    Attributes:
        contact_probability: Probability that each foot is on the ground, as of the last loads [1]; NaN where the force
            is not known.
        holds: Probability that each foot stands still on the ground, same [1].
    """

    def __init__(
        self,
        n_legs: int,
        friction: float = math.nan,
        period_ns: int = SLOW_PERIOD_NS,
    ) -> None:
        self._friction = friction
        self._ground, self._tells_slips = GroundFriction(friction), math.isfinite(friction)
        self._holding = [Holding(self._ground) for _ in range(n_legs)]
        # Which legs are looked at, and when each half of them was last [ns].
        self._turn, self._looked_ns = 0, [0] * _CONVERSIONS_PER_CHECK
        self._period_ns, self._due_ns = period_ns, 0
        # Whether the force is known, and whether the foot is in contact, of each leg.
        self._states = [(False, False)] * n_legs
        # Contact of each leg when its force was last known, and when that was; None: not known for long.
        self._told: list[bool | None] = [None] * n_legs
        self._known_ns = [0] * n_legs
        self._touchdowns, self._lift_offs = [NO_TIME] * n_legs, [NO_TIME] * n_legs
        self.contact_probability, self.holds = [math.nan] * n_legs, [math.nan] * n_legs

    def observe(
        self, load: LoadEstimate, contacts: Sequence[ContactDetector], now_ns: int
    ) -> GaitFrame | None:
        """Process the loads of one conversion; return the gait if an event occurred or a frame is due, else None.

        Args:
            load: Loads of all legs as of `now_ns`; NaN forces where they may not be used.
            contacts: Contact of each leg, as of the same readings.
            now_ns: Current time [ns].
        """
        states, probabilities = [], []
        for force_n, contact, told in zip(load.force_n[:, 2].tolist(), contacts, self._told, strict=True):
            # One that began without a known force begins here with a load that is known.
            in_contact = contact.in_contact and (contact.raw or told is not False)
            is_known = math.isfinite(force_n + contact.load_n)
            states.append((is_known, in_contact))
            probabilities.append(contact.probability if is_known else math.nan)
        self.contact_probability = probabilities
        events: list[GaitEvent] = []
        if states != self._states:
            for row, (before, now) in enumerate(zip(self._states, states, strict=True)):
                if now != before:
                    events += self._contact_events(row, before, now, contacts[row].changed, now_ns)
            self._states = states
        events += self._slips(load, now_ns)
        self.holds = [
            probability * holding.probability
            for holding, probability in zip(self._holding, probabilities, strict=True)
        ]
        if not events and now_ns < self._due_ns:
            return None
        if now_ns >= self._due_ns and self._period_ns:
            self._due_ns = (now_ns // self._period_ns + 1) * self._period_ns
        return self._gait_frame(load, contacts, now_ns, tuple(events))

    def _slips(self, load: LoadEstimate, now_ns: int) -> list[GaitEvent]:
        """Look at the friction ratios of the feet whose turn it is; return the slips that begin or end."""
        self._turn = turn = (self._turn + 1) % _CONVERSIONS_PER_CHECK
        elapsed_s = 1e-9 * min(now_ns - self._looked_ns[turn], LONG_SILENCE_NS)
        self._looked_ns[turn] = now_ns
        rows = slice(turn, None, _CONVERSIONS_PER_CHECK)
        states = self._states[rows]
        if not turn:
            self._ground.pass_time(elapsed_s)
        events: list[GaitEvent] = []
        if _FORCE_KNOWN_IN_CONTACT in states:
            for number, (state, holding, foot) in enumerate(
                zip(states, self._holding[rows], foot_loads(load, rows), strict=True)
            ):
                if (
                    state == _FORCE_KNOWN_IN_CONTACT
                    and holding.observe(*friction_ratio(foot), elapsed_s, now_ns)
                    and self._tells_slips
                ):
                    kind = GaitEventKind.SLIP if holding.slips else GaitEventKind.SLIP_END
                    leg = turn + _CONVERSIONS_PER_CHECK * number
                    t_ns = max(holding.since_ns - _SLIP_LAG_NS, self._touchdowns[leg].t_ns)
                    events.append(GaitEvent(kind, leg, t_ns, SAME_ERROR_S))
        return events

    def _contact_events(
        self, row: int, before: tuple[bool, bool], now: tuple[bool, bool], dated: BackDated, now_ns: int
    ) -> list[GaitEvent]:
        is_known, in_contact = now
        holding = self._holding[row]
        was_slipping = holding.slips and self._tells_slips
        if now != _FORCE_KNOWN_IN_CONTACT:
            holding.reset_stance()
        if before[0]:
            self._known_ns[row] = now_ns
        if not is_known:
            return []
        # A contact that began or ended while the force was not known for long has no event, and no time.
        unknown_ns, told = now_ns - self._known_ns[row], self._told[row]
        self._told[row] = in_contact
        if told is None or unknown_ns > LONG_SILENCE_NS:
            self._touchdowns[row] = self._lift_offs[row] = NO_TIME
            return []
        if told is in_contact:
            return []
        if in_contact:
            kinds = [GaitEventKind.TOUCHDOWN]
            own, other = self._touchdowns, self._lift_offs
        else:
            kinds = [GaitEventKind.LIFT_OFF]
            own, other = self._lift_offs, self._touchdowns
            if was_slipping:
                kinds.insert(0, GaitEventKind.SLIP_END)
        # A foot cannot touch before it was lifted, nor be lifted before it touched, and nothing happens later than now.
        t_ns = min(max(dated.t_ns, other[row].t_ns + 1), now_ns)
        own[row] = BackDated(t_ns, math.hypot(dated.sigma_s, 0.5 * 1e-9 * unknown_ns))
        return [GaitEvent(kind, row, *own[row]) for kind in kinds]

    def _gait_frame(
        self,
        load: LoadEstimate,
        contacts: Sequence[ContactDetector],
        now_ns: int,
        events: tuple[GaitEvent, ...],
    ) -> GaitFrame:
        known, contact = np.array(self._states, np.bool_).T
        pressing_n = np.where(contact, np.maximum(load.force_n[:, 2], 0.0), 0.0)
        total_n = float(pressing_n[known].sum())
        grounds = [
            ground_of(foot) if state == _FORCE_KNOWN_IN_CONTACT else NO_GROUND
            for state, foot in zip(self._states, foot_loads(load), strict=True)
        ]
        _, normal, normal_sigma_rad, ratio, network_sigma = zip(*grounds, strict=True)
        touchdown_ns, touchdown_sigma_s = zip(*self._touchdowns, strict=True)
        lift_off_ns, lift_off_sigma_s = zip(*self._lift_offs, strict=True)
        return GaitFrame(
            t_ns=now_ns,
            contact=contact,
            contact_raw=np.array([leg.raw for leg in contacts]),
            touchdown_ns=np.array(touchdown_ns, np.int64),
            touchdown_sigma_s=np.array(touchdown_sigma_s),
            lift_off_ns=np.array(lift_off_ns, np.int64),
            lift_off_sigma_s=np.array(lift_off_sigma_s),
            load_share=np.where(known, pressing_n, np.nan) / (total_n or math.nan),
            normal=np.array(normal),
            normal_sigma_rad=np.array(normal_sigma_rad),
            tangential_over_normal=np.array(ratio),
            tangential_over_normal_sigma=np.array(list(map(ratio_sigma, ratio, network_sigma))),
            slip=np.array([self._slip_of(holding) for holding in self._holding], np.uint8),
            friction=self._friction,
            all_in_air=bool((known & ~contact).all()),
            events=events,
        )

    def _slip_of(self, holding: Holding) -> Slip:
        if not (self._tells_slips and holding.is_known):
            return Slip.UNKNOWN
        return Slip.SLIPPING if holding.slips else Slip.NONE
