"""How far the forces of every leg may be trusted at this moment; the same machine as `footsense_link.h`.

Feed it every frame that arrives, and ask it whenever you need a force. What the five statuses mean, when a force
may be used, and why it needs its quality, stands in `firmware_interface/c/footsense_link.h`; the two run on the
same vectors.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from firmware_interface.can_codes import NODE_IDS, USABLE, Flag, State
from firmware_interface.can_frames import FORCE_ID, QUALITY_ID, Force, Quality, decode_force, decode_quality
from firmware_interface.crc8 import COUNTER_PERIOD, FrameError

__all__ = ["LINK_IDS", "Limits", "Link", "Status", "View"]

#: CAN ids of the frames that are taken.
LINK_IDS = tuple(base + node for base in (FORCE_ID, QUALITY_ID) for node in NODE_IDS.values())

_NAN = float("nan")
_NO_FORCE = (_NAN, _NAN, _NAN)


class Status(IntEnum):
    """What the stream of a leg's frames is worth."""

    STALE = 0  #: nothing has come for too long, or not enough since then; or the force is too old
    OK = 1  #: the last force is whole, in order, and young enough
    LOST = 2  #: the same, but some before it did not arrive
    REPEATED = 3  #: the last frame came a second time: the counter stands still
    WRONG = 4  #: a frame failed its check, and not enough good ones have come since


@dataclass(frozen=True, slots=True)
class Limits:
    """When to trust; the defaults are for forces every 25 ms.

    Attributes:
        max_age_ns: A force older than this is stale [ns].
        timeout_ns: Without a force for this long, the link is down [ns].
        max_delta: Largest step of the counter, 1..14: one less forces may be lost in a row.
        min_good: Forces in order that it takes to trust the link (again), at least 1.
        accept_degraded: Whether forces of state DEGRADED are used; weigh them by sigma.
    """

    max_age_ns: int = 100_000_000
    timeout_ns: int = 100_000_000
    max_delta: int = 3
    min_good: int = 3
    accept_degraded: bool = False


class View(NamedTuple):
    """What is known of a leg at a moment.

    Attributes:
        status: What its frames are worth.
        usable: Whether the force may be used.
        state: State of the leg, as last said; ABSENT before anything was said.
        flags: Notes that came with the last force.
        fault_mask: Bit e set where element e is not usable, 9 bits.
        force_n: Ground reaction on the foot in the foot frame [N]; NaN unless usable.
        sigma_n: Standard deviation of each component [N]; NaN unless usable.
        age_ns: Age of the measurement, now [ns]; None unless usable.
    """

    status: Status
    usable: bool
    state: State
    flags: Flag
    fault_mask: int
    force_n: tuple[float, float, float]
    sigma_n: tuple[float, float, float]
    age_ns: int | None


class Link:
    """The legs of a robot, as a consumer of CAN may believe them. It has no clock of its own.

    Example:
        >>> link = Link()
        >>> link.look(1, now_ns=0).status
        <Status.STALE: 0>
    """

    def __init__(self, limits: Limits | None = None) -> None:
        self._limits = limits or Limits()
        self._legs = {node: _Leg(self._limits) for node in NODE_IDS.values()}

    def feed(self, can_id: int, data: bytes, now_ns: int) -> bool:
        """Take a frame of any id.

        Args:
            can_id: Its 11-bit id.
            data: Its bytes.
            now_ns: Time of arrival, on a clock that does not step [ns].

        Returns:
            Whether it was a `Force` or `Quality` of a leg, good or not.
        """
        for base, decode in ((FORCE_ID, decode_force), (QUALITY_ID, decode_quality)):
            if can_id - base in self._legs:
                leg = self._legs[can_id - base]
                try:
                    half = decode(can_id, data)
                except FrameError:
                    leg.take_wrong(now_ns)
                else:
                    leg.take(half, now_ns)
                return True
        return False

    def look(self, node: int, now_ns: int) -> View:
        """Return what is known of a leg.

        Args:
            node: Its CAN node id, 1..6.
            now_ns: The time to judge it at [ns].
        """
        return self._legs[node].look(now_ns)


class _Leg:
    """One leg's memory."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._force: Force | None = None  # the last that came with its quality
        self._quality: Quality | None = None
        self._state = State.ABSENT  # as last said
        self._arrived_ns = 0
        self._next: dict[type, Force | Quality] = {}  # the halves of the one that is arriving
        self._next_ns = 0
        self._wrong_ns = 0
        self._n_good = 0
        self._status = Status.STALE

    def take(self, half: Force | Quality, now_ns: int) -> None:
        """Take a frame that is right in itself."""
        if not self._is_silent(now_ns) and self._force and half.counter == self._force.counter:
            self._take_repeated()
            return
        counters = {other.counter for other in self._next.values()}
        if counters - {half.counter} or _is_over(now_ns, self._next_ns, self._limits.timeout_ns):
            self._next.clear()
        if type(half) in self._next:
            self._take_repeated()
            return
        if not self._next:
            self._next_ns = now_ns
        self._next[type(half)] = half
        if isinstance(half, Force) and half.state not in USABLE:
            self._state = half.state  # bad news needs no proof
        force, quality = self._next.get(Force), self._next.get(Quality)
        if isinstance(force, Force) and isinstance(quality, Quality):
            self._next.clear()
            self._take_force(force, quality, now_ns)

    def take_wrong(self, now_ns: int) -> None:
        """Take a frame that failed its check."""
        self._distrust(Status.WRONG)
        self._wrong_ns = now_ns
        self._next.clear()

    def look(self, now_ns: int) -> View:
        """Return what is known of the leg."""
        status = self._status_at(now_ns)
        state, force, quality = self._state, self._force, self._quality
        allowed = state == State.VALID or (state == State.DEGRADED and self._limits.accept_degraded)
        usable = status in {Status.OK, Status.LOST} and allowed
        flags, mask = (quality.flags, quality.fault_mask) if quality else (Flag(0), 0)
        if not usable or force is None or quality is None or quality.age_ns is None or _has_hole(force):
            return View(status, False, state, flags, mask, _NO_FORCE, _NO_FORCE, None)
        age_ns = quality.age_ns + now_ns - self._arrived_ns
        return View(status, True, state, flags, mask, force.force_n, quality.sigma_n, age_ns)

    def _take_force(self, force: Force, quality: Quality, now_ns: int) -> None:
        """Take a force that came with its quality."""
        counts, delta = True, 1
        if self._is_silent(now_ns) or self._force is None:
            self._distrust(Status.STALE)  # whatever the counter says: who was silent may have begun anew
        else:
            delta = (force.counter - self._force.counter) % COUNTER_PERIOD
            if delta > self._limits.max_delta:
                self._distrust(Status.WRONG)
                self._wrong_ns = now_ns
                counts = False
        self._force, self._quality, self._state = force, quality, force.state
        self._arrived_ns = self._next_ns
        self._n_good += counts
        if self._is_trusted():
            self._status = Status.OK if delta == 1 else Status.LOST

    def _take_repeated(self) -> None:
        if self._is_trusted():
            self._status = Status.REPEATED

    def _distrust(self, why: Status) -> None:
        self._status = why
        self._n_good = 0

    def _is_trusted(self) -> bool:
        return self._n_good >= max(1, self._limits.min_good)

    def _is_silent(self, now_ns: int) -> bool:
        return self._force is None or _is_over(now_ns, self._arrived_ns, self._limits.timeout_ns)

    def _status_at(self, now_ns: int) -> Status:
        if self._is_silent(now_ns):
            over = _is_over(now_ns, self._wrong_ns, self._limits.timeout_ns)
            return Status.WRONG if self._status is Status.WRONG and not over else Status.STALE
        # Only a force has an age; that a leg is absent stays true.
        if self._status is not Status.WRONG and self._state in USABLE and self._is_too_old(now_ns):
            return Status.STALE
        return self._status

    def _is_too_old(self, now_ns: int) -> bool:
        age_ns = self._quality.age_ns if self._quality else None
        return age_ns is None or _is_over(now_ns, self._arrived_ns, self._limits.max_age_ns - age_ns)


def _is_over(now_ns: int, since_ns: int, limit_ns: int) -> bool:
    """Return whether more than `limit_ns` has passed; a clock that ran backwards has run out."""
    return not 0 <= now_ns - since_ns <= limit_ns


def _has_hole(force: Force) -> bool:
    return any(component != component for component in force.force_n)  # noqa: PLR0124 - NaN
