"""State machine that decides whether each leg's force may be used; in C: `firmware_interface/c/footsense_link.h`.

Feed it every frame that arrives, and read a leg whenever a force is needed. `footsense_link.h` explains the
statuses, when a force may be used, and why it needs its `Quality`; both implementations run on the same vectors.

Source:
    AUTOSAR FO R22-11, PRS E2EProtocol, E2E state machine; here with a timeout and an age limit.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

from firmware_interface.can.codes import NODE_IDS, USABLE, Flag, State
from firmware_interface.can.crc8 import COUNTER_PERIOD, FrameError, kind_and_node
from firmware_interface.can.force import FORCE, QUALITY, Force, Quality
from firmware_interface.can.reports import FAULT, IDENTITY, Fault, Identity
from firmware_interface.can.signals import Codec

#: Of the accepted frames, by their CAN id without the node.
_CODECS: dict[int, Codec[Any]] = {codec.can_id: codec for codec in (FORCE, QUALITY, IDENTITY, FAULT)}
#: CAN ids of the accepted frames.
LINK_IDS = tuple(base + node for base in _CODECS for node in NODE_IDS.values())

#: Shortest silence of a leg in which its service may have been started anew, with other feet [ns].
_RESTART_NS = 300_000_000

#: Two services: how long their signs count, within what time an `Identity` follows on the last one, of which it is
#: one more, and within what it may be the same frame sent again [ns].
_CONFLICT_NS, _IDENTITY_PERIOD_NS, _SENT_AGAIN_NS = 3_000_000_000, 1_500_000_000, 10_000_000

_NO_FORCE = (math.nan, math.nan, math.nan)


class LinkStatus(IntEnum):
    """Status of a leg's forces by the age and sequence of its CAN frames."""

    STALE = 0  #: no force for `timeout_ns`, or fewer than `min_good` since then; or the force is too old
    OK = 1  #: the last force is valid, in sequence, and young enough
    LOST = 2  #: the same, but up to `max_delta` - 1 forces before it did not arrive
    REPEATED = 3  #: the last frame came again: its counter has not advanced
    WRONG = 4  #: a check failed, or too many frames were lost; until `min_good` forces have come
    UNKNOWN = 5  #: forces come, but their step and version are not known yet: `Identity` comes once a second
    REFUSED = 6  #: `Identity` has a version or a force step that this decoder does not know
    CONFLICT = 7  #: two services send forces of this leg, by their `Identity`, until 3 s after the last sign


@dataclass(frozen=True, slots=True)
class LinkLimits:
    """Limits for using a force (age, timeout, losses); the defaults suit forces every 11 to 25 ms.

    Attributes:
        max_age_ns: A force older than this is stale [ns].
        timeout_ns: Without a force for this long, the link is down [ns].
        max_delta: Largest step of the sequence counter, 1..14; `max_delta` - 1 forces may be lost in a row.
        min_good: Forces in sequence before the link is OK (again), at least 1.
        accept_degraded: Whether forces of state DEGRADED are used; weigh them by sigma.
    """

    max_age_ns: int = 100_000_000
    timeout_ns: int = 100_000_000
    max_delta: int = 3
    min_good: int = 3
    accept_degraded: bool = False


class LegForce(NamedTuple):
    """A leg's latest force, and whether a controller may use it.

    Attributes:
        status: LinkStatus of its frames.
        usable: Whether the force may be used.
        state: Last reported state of the leg; ABSENT before the first report.
        flags: Flags of the last force.
        fault_mask: Bit e set where element e is not usable or overloaded; None until it comes, within a second.
        force_n: Ground reaction on the foot in the foot frame [N]; NaN unless usable.
        sigma_n: Standard deviation of each component [N]; NaN unless usable. In the air a fiftieth of the largest force
            along the leg, far above the noise: a touch may have begun since the readings.
        age_ns: Present age of the measurement [ns]; None unless usable.
        contact_probability: Probability that the foot is on the ground [1]; NaN unless usable.
        holds: Probability that the foot stands still on the ground [1]; NaN unless usable and known.
    """

    status: LinkStatus
    usable: bool
    state: State
    flags: Flag
    fault_mask: int | None
    force_n: tuple[float, float, float]
    sigma_n: tuple[float, float, float]
    age_ns: int | None
    contact_probability: float = math.nan
    holds: float = math.nan

    @property
    def age_s(self) -> float:
        """Present age of the measurement [s]; NaN unless usable."""
        return math.nan if self.age_ns is None else round(self.age_ns * 1e-9, 6)

    @property
    def contact(self) -> bool | None:
        """Whether the foot is in contact with the ground; None unless usable."""
        return Flag.CONTACT in self.flags if self.usable else None


class Link:
    """Receiver of all legs' forces on CAN, which decides whether each may be used; the caller supplies the times.

    Args:
        limits: Limits for using a force; None for the defaults.

    Example:
        >>> link = Link()
        >>> link.leg(1, now_ns=0).status
        <LinkStatus.STALE: 0>
    """

    def __init__(self, limits: LinkLimits | None = None) -> None:
        self._legs = {node: _LegStateMachine(limits or LinkLimits()) for node in NODE_IDS.values()}

    def feed(self, can_id: int, data: bytes, now_ns: int) -> bool:
        """Process any CAN frame; return whether its id is that of a force frame, even if the frame is invalid.

        Args:
            can_id: Its 11-bit id.
            data: Its bytes.
            now_ns: Time of arrival, on a clock that does not step [ns].

        Returns:
            Whether it was a `Force`, `Quality`, `Identity` or `Fault` of a leg, valid or not.
        """
        if can_id not in LINK_IDS:
            return False
        base, node = kind_and_node(can_id)
        try:
            self._legs[node].process_frame(_CODECS[base].decode(can_id, data), now_ns)
        except FrameError:
            if base in {FORCE.can_id, QUALITY.can_id}:  # the next one of the others comes in a second
                self._legs[node].process_corrupt_frame(now_ns)
        return True

    def leg(self, node: int, now_ns: int) -> LegForce:
        """Return a leg's latest force, and whether it may be used at `now_ns`.

        Args:
            node: Its CAN node id, 1..8.
            now_ns: The present time [ns].
        """
        return self._legs[node].force_at(now_ns)

    def identity(self, node: int) -> Identity | None:
        """Return version, force step and foot type of a leg, as last received; None if they are not known.

        Args:
            node: Its CAN node id, 1..8.
        """
        return self._legs[node].identity


class _LegStateMachine:
    """State machine of one leg's forces.

    Attributes:
        identity: Last `Identity` of the leg.
        fault: Last `Fault` of the leg.
    """

    def __init__(self, limits: LinkLimits) -> None:
        self._limits = limits
        self._last: tuple[Force, Quality] | None = None  # the last force that is complete
        self._state = State.ABSENT  # as last reported
        self._arrived_ns = 0
        self._next: dict[type, Force | Quality] = {}  # the halves received so far
        self._next_ns = 0
        self._wrong_ns = 0
        self._n_good = 0
        self._status = LinkStatus.STALE
        self.identity: Identity | None = None
        self.fault: Fault | None = None
        self._identity_ns = 0
        self._conflict_ns: int | None = None

    def process_frame(self, frame: Force | Quality | Identity | Fault, now_ns: int) -> None:
        """Process a frame with a valid CRC."""
        if isinstance(frame, Identity):
            self._process_identity(frame, now_ns)
        elif isinstance(frame, Fault):
            self.fault = frame
        else:
            self._process_half(frame, now_ns)

    def _process_identity(self, identity: Identity, now_ns: int) -> None:
        """Process an `Identity`.

        A service sends the same until it ends, and counts: while forces come, who sends something else, or does not
        count on, is a second one.
        """
        last, since_ns = self.identity, self._identity_ns
        if last is not None and not self._is_silent(now_ns):
            counts_on = identity.counter == (last.counter + 1) % COUNTER_PERIOD
            sent_again = identity == last and not _has_elapsed(now_ns, since_ns, _SENT_AGAIN_NS)
            is_late = _has_elapsed(now_ns, since_ns, _IDENTITY_PERIOD_NS)
            if identity[2:] != last[2:] or not (counts_on or sent_again or is_late):
                self._reset(LinkStatus.STALE)
                self._conflict_ns = now_ns
        self.identity, self._identity_ns = identity, now_ns

    def _process_half(self, half: Force | Quality, now_ns: int) -> None:
        """Process a `Force` or `Quality`."""
        if not self._is_silent(now_ns) and self._last and half.counter == self._last[0].counter:
            self._mark_repeated()
            return
        counters = {other.counter for other in self._next.values()}
        if counters - {half.counter} or _has_elapsed(now_ns, self._next_ns, self._limits.timeout_ns):
            self._next.clear()
        if type(half) in self._next:
            self._mark_repeated()
            return
        if not self._next:
            self._next_ns = now_ns
        self._next[type(half)] = half
        if isinstance(half, Force) and half.state not in USABLE:
            self._state = half.state  # a state without force takes effect at once
        force, quality = self._next.get(Force), self._next.get(Quality)
        if isinstance(force, Force) and isinstance(quality, Quality):
            self._next.clear()
            self._accept_force(force, quality, now_ns)

    def process_corrupt_frame(self, now_ns: int) -> None:
        """Process a frame that failed its CRC or format check."""
        self._reset(LinkStatus.WRONG)
        self._wrong_ns = now_ns
        self._next.clear()

    def force_at(self, now_ns: int) -> LegForce:
        """Return the latest force, and whether it may be used at `now_ns`."""
        status, state = self._status_at(now_ns), self._state
        mask = self.fault and self.fault.fault_mask
        if self._last is None:
            return LegForce(status, False, state, Flag(0), mask, _NO_FORCE, _NO_FORCE, None)
        force, quality = self._last
        allowed = state == State.VALID or (state == State.DEGRADED and self._limits.accept_degraded)
        usable = status in {LinkStatus.OK, LinkStatus.LOST} and allowed
        if not usable or quality.age_ns is None or any(map(math.isnan, force.force_n + quality.sigma_n)):
            return LegForce(status, False, state, quality.flags, mask, _NO_FORCE, _NO_FORCE, None)
        assert self.identity is not None
        step, age_ns = self.identity.force_step_mn, quality.age_ns + now_ns - self._arrived_ns
        force_n, sigma_n = (
            (round(x * step, 6), round(y * step, 6), round(z * step, 6))  # of whole uN
            for x, y, z in (force.force_n, quality.sigma_n)
        )
        contact = quality.contact_probability, quality.holds
        return LegForce(status, True, state, quality.flags, mask, force_n, sigma_n, age_ns, *contact)

    def _accept_force(self, force: Force, quality: Quality, now_ns: int) -> None:
        """Store a force once both of its frames (`Force`, `Quality`) have arrived."""
        if self._last and all(
            _has_elapsed(now_ns, t_ns, _RESTART_NS) for t_ns in (self._arrived_ns, self._identity_ns)
        ):
            self.identity = None
        counts, delta = True, 1
        if self._is_silent(now_ns) or self._last is None:
            self._reset(LinkStatus.STALE)  # after a silence the sender may have restarted: ignore the counter
        else:
            delta = (force.counter - self._last[0].counter) % COUNTER_PERIOD
            if delta > self._limits.max_delta:
                self._reset(LinkStatus.WRONG)
                self._wrong_ns = now_ns
                counts = False
        self._last, self._state = (force, quality), force.state
        self._arrived_ns = self._next_ns
        self._n_good += counts
        if self._has_enough_good_forces():
            self._status = LinkStatus.OK if delta == 1 else LinkStatus.LOST

    def _mark_repeated(self) -> None:
        """Set the status REPEATED, unless too few good frames have arrived."""
        if self._has_enough_good_forces():
            self._status = LinkStatus.REPEATED

    def _reset(self, new_status: LinkStatus) -> None:
        """Set a new status, and restart the count of good frames."""
        self._status = new_status
        self._n_good = 0

    def _has_enough_good_forces(self) -> bool:
        """Return whether enough forces in sequence have arrived since the last error or silence."""
        return self._n_good >= max(1, self._limits.min_good)

    def _is_silent(self, now_ns: int) -> bool:
        """Return whether no complete force has arrived yet, or none for longer than the timeout."""
        return self._last is None or _has_elapsed(now_ns, self._arrived_ns, self._limits.timeout_ns)

    def _status_at(self, now_ns: int) -> LinkStatus:
        """Return the status of the forces at a time [ns]."""
        if self._is_silent(now_ns):
            over = _has_elapsed(now_ns, self._wrong_ns, self._limits.timeout_ns)
            return LinkStatus.WRONG if self._status is LinkStatus.WRONG and not over else LinkStatus.STALE
        if self._conflict_ns is not None and not _has_elapsed(now_ns, self._conflict_ns, _CONFLICT_NS):
            return LinkStatus.CONFLICT
        # Only a force ages; a state without force stays valid.
        if self._status is not LinkStatus.WRONG and self._state in USABLE and self._is_too_old(now_ns):
            return LinkStatus.STALE
        if self._status in {LinkStatus.STALE, LinkStatus.WRONG} or (self.identity and self.identity.is_known):
            return self._status
        return LinkStatus.REFUSED if self.identity else LinkStatus.UNKNOWN

    def _is_too_old(self, now_ns: int) -> bool:
        """Return whether the latest force is older than the age limit."""
        age_ns = self._last[1].age_ns if self._last else None
        return age_ns is None or _has_elapsed(now_ns, self._arrived_ns, self._limits.max_age_ns - age_ns)


def _has_elapsed(now_ns: int, since_ns: int, limit_ns: int) -> bool:
    """Return whether more than `limit_ns` has passed since `since_ns`; True if the clock ran backwards."""
    return not 0 <= now_ns - since_ns <= limit_ns
