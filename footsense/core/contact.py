"""Whether a foot is on the ground: level and rate of its load, in newtons and seconds.

The load is judged above a floor, not above the zero: in the air the floor follows the load down at once and up no
faster than `floor_n_per_s`, on the ground it stands still. So drift, which is slow, never makes contact, whatever it
adds up to, and a touchdown, which is fast, is seen in the first reading that is `touch_n` above the floor. A load that
comes more slowly than `floor_n_per_s` cannot be told from drift, and is not.

A foot has left the ground when its load is back within `lift_n` of the floor. After a long stance it may never be: the
zero has drifted meanwhile, and rubber that was pressed goes back over minutes. So a load that has fallen fast, to a
small part of what it was, also counts as lift-off as soon as drift and creep could explain what is left. A foot that
carries little without having carried more just before stays in contact, however long.

One element alone makes no contact: the largest and the smallest closure are left out of the load.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.frames import CommandKind

Vector = NDArray[np.float64]
Stamps = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: Lift-off in a fall: less is left than this part of the mean load of the last second or so.
_FALLEN_REL = 0.3
_RECENT_S = 1.0

#: What pressed rubber may still owe after lift-off, over what it carried on average in the last minutes. An assumption
#: on the safe side: Prony series of PDMS add 2 to 5 % over minutes; no foot has been measured.
_CREEP_REL = 0.05
_CARRIED_S = 100.0

#: Without a reading, contact is believed for so long, and is unknown after that.
_BELIEVED_NS = 250_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactLimits:
    """When a foot counts as on the ground, and when as surely in the air.

    Attributes:
        touch_n: Load above the floor that is contact [N].
        floor_n_per_s: Fastest rise of the floor [N/s]: five times the fastest drift, a fiftieth of a slow load.
        confirmed_s: Time after lift-off from which a swing is confirmed [s]; most of the rubber's quick recovery is
            over by then, and half the swing of a fast gait is left.
    """

    touch_n: float
    floor_n_per_s: float = 0.5e-3
    confirmed_s: float = 0.2

    @property
    def lift_n(self) -> float:
        """Load above the floor below which contact ends [N]: half of `touch_n`, so that it does not chatter."""
        return self.touch_n / 2


def middle_mean(closure_rel: Vector) -> Vector:
    """Return the mean closure of each leg without its largest and smallest, shape (legs,).

    Args:
        closure_rel: Closures over the gap [1], shape (legs, 9), NaN where there is none.

    Returns:
        Mean [1]; NaN for a leg with fewer than three closures.

    Example:
        >>> middle_mean(np.array([[0.0, 1.0, 2.0, 9.0, np.nan]])).tolist()
        [1.5]
    """
    n_read = np.isfinite(closure_rel).sum(axis=1)
    # fmax and fmin pass NaN by, without the warnings of nanmax.
    extremes = np.fmax.reduce(closure_rel, axis=1) + np.fmin.reduce(closure_rel, axis=1)
    middle = np.nansum(closure_rel, axis=1) - extremes
    mean: Vector = np.where(n_read > 2, middle / np.maximum(n_read - 2, 1), np.nan)
    return mean


class Contacts:
    """Which legs are on the ground.

    Args:
        n_legs: Legs of the robot.
        limits: When a foot is on the ground.

    Attributes:
        touching: Legs that are, shape (legs,).
        load_n: Load along the leg above its zero [N], shape (legs,), NaN where it is not known.
        doubt_n: How much of a load drift and creep alone could explain now [N], shape (legs,).
    """

    def __init__(self, n_legs: int, limits: ContactLimits) -> None:
        self.touching = np.zeros(n_legs, bool)
        self.load_n = np.full(n_legs, np.nan)
        self.doubt_n = np.zeros(n_legs)
        self._limits = limits
        self._floor_n = np.zeros(n_legs)
        self._recent_n = np.zeros(n_legs)
        self._carried_n = np.zeros(n_legs)
        self._t_ns = np.zeros(n_legs, np.int64)
        self._lifted_ns = np.zeros(n_legs, np.int64)

    def observe(self, load_n: Vector, zero_doubt_n: Vector, t_ns: Stamps, now_ns: int) -> None:
        """Judge the newest load of each leg.

        Args:
            load_n: Load along the leg above its zero [N], shape (legs,), NaN where it is not known.
            zero_doubt_n: How far the zero may be off [N], shape (legs,).
            t_ns: When the newest of the readings was taken [ns], shape (legs,).
            now_ns: The time now [ns].
        """
        limits = self._limits
        known = np.isfinite(load_n)
        lost = ~known & (now_ns - self._t_ns > _BELIEVED_NS)
        if lost.any():
            self._begin_anew(lost, now_ns)
        self.load_n = load_n
        load_n = np.where(known, load_n, 0.0)
        passed_s = np.where(known, np.maximum(t_ns - self._t_ns, 0) * 1e-9, 0.0)
        self.doubt_n = zero_doubt_n + _CREEP_REL * self._carried_n

        above_n = load_n - self._floor_n
        explained = above_n < limits.lift_n + self.doubt_n
        fell = explained & (load_n < _FALLEN_REL * self._recent_n)
        lifting = known & self.touching & (fell | (above_n < limits.lift_n))
        touching = known & ~self.touching & (above_n > limits.touch_n)
        changed = lifting | touching
        if changed.any():
            self.touching = self.touching ^ changed
            self._lifted_ns[lifting] = t_ns[lifting]
            self._floor_n[lifting] = load_n[lifting]
        risen_n = np.minimum(load_n, self._floor_n + limits.floor_n_per_s * passed_s)
        self._floor_n = np.where(known & ~self.touching, risen_n, self._floor_n)

        pressed_n = np.maximum(load_n, 0.0)
        self._recent_n += (pressed_n - self._recent_n) * (passed_s / (_RECENT_S + passed_s))
        self._carried_n += (pressed_n - self._carried_n) * (passed_s / (_CARRIED_S + passed_s))
        self._t_ns = np.where(known, t_ns, self._t_ns)

    def confirmed(self) -> Mask:
        """Tell which legs are surely in the air: off the ground for a while, and not about to touch, shape (legs,)."""
        aloft_s = (self._t_ns - self._lifted_ns) * 1e-9
        settled = self.load_n - self._floor_n < self._limits.lift_n / 2
        return settled & ~self.touching & (aloft_s >= self._limits.confirmed_s)

    def explained(self) -> Mask:
        """Tell for which legs drift and creep could explain the whole load, shape (legs,); False where unknown."""
        within: Mask = np.abs(self.load_n) <= self._limits.lift_n + self.doubt_n
        return within

    def begin_anew(self, leg: int, now_ns: int) -> None:
        """Forget a leg's history: it has a new zero, or perhaps a new foot."""
        which = np.zeros(len(self.touching), bool)
        which[leg] = True
        self._begin_anew(which, now_ns)
        self._carried_n[leg] = 0.0

    def refusal(self, kind: CommandKind, leg: int) -> str | None:
        """Return why a command may not be obeyed now, or None if it may."""
        return refusal(
            kind,
            touching=bool(self.touching[leg]),
            load_n=float(self.load_n[leg]),
            doubt_n=float(self.doubt_n[leg]),
        )

    def _begin_anew(self, which: Mask, now_ns: int) -> None:
        self.touching = self.touching & ~which
        for history in (self._floor_n, self._recent_n):
            history[which] = 0.0
        for stamps in (self._t_ns, self._lifted_ns):
            stamps[which] = now_ns


def refusal(kind: CommandKind, *, touching: bool, load_n: float, doubt_n: float) -> str | None:
    """Return why a command to one leg may not be obeyed now, or None if it may.

    A controller that leans on a leg must not lose its force by one frame, so a leg in contact is not stopped. Nor is
    it tared, unless what it seems to carry may be drift and creep alone: then the tare itself judges, for a foot that
    was lifted as slowly as drift is still in contact here. Where contact is not known, as without a zero, there is no
    force to lose: the leg may be stopped, and a tare is judged by its readings. START is always safe.

    Args:
        kind: What is asked for.
        touching: Whether the foot is in contact.
        load_n: Load along the leg [N], NaN where it is not known.
        doubt_n: How much of it drift and creep alone could explain [N].

    Example:
        >>> refusal(CommandKind.STOP, touching=True, load_n=0.4, doubt_n=0.02)
        'the foot is on the ground: it carries 0.40 N'
    """
    if not touching or kind is CommandKind.START:
        return None
    if kind is CommandKind.TARE and load_n <= doubt_n:
        return None
    carries = "its load is not known now" if np.isnan(load_n) else f"it carries {load_n:.2f} N"
    doubt = f", and drift explains at most {doubt_n:.2f} N" if kind is CommandKind.TARE else ""
    return f"the foot is on the ground: {carries}{doubt}"
