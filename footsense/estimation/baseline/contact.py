"""Whether a foot is on the ground: level and rate of its load, in newtons and seconds.

The load is judged above a floor, not above the zero: in the air the floor follows the load down as soon as it has been
that low for a twentieth of a second, and up no faster than `floor_n_per_s`; on the ground it stands still. So drift,
which is slow, never makes contact, whatever it adds up to, and a touchdown, which is fast, is seen in the first reading
that is `touch_n` above the floor. A load that comes more slowly than `floor_n_per_s` cannot be told from drift, and is
not.

A foot has left the ground when its load is back within `lift_n` of the floor. After a long stance it may never be: the
zero has drifted meanwhile, and rubber that was pressed goes back over minutes. So a load that has fallen fast, to a
small part of what it was, also counts as lift-off as soon as drift and creep could explain what is left. A foot that
carries little without having carried more just before stays in contact, however long.

One element alone makes no contact: the largest and the smallest closure are left out of the load.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.frames import CommandKind

Vector = NDArray[np.float64]

#: Lift-off in a fall: less is left than this part of the mean load of the last second or so.
_FALLEN_REL = 0.3
_RECENT_S = 1.0

#: What pressed rubber may still owe after lift-off, over what it carried on average in the last minutes. An assumption
#: on the safe side: Prony series of PDMS add 2 to 5 % over minutes; no foot has been measured.
_CREEP_REL = 0.05
_CARRIED_S = 100.0

#: How long a load has to be low before the floor goes there: a glitch downwards must not make contact afterwards.
_LOW_NS = 50_000_000

#: A contact that was foreseen is held for so long: by then every element has been read again.
_FORESEEN_NS = 30_000_000
#: After a lift-off a prediction rings for so long, and foresees nothing.
_RINGS_NS = 100_000_000

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


def middle_mean(closure_rel: Vector) -> list[float]:
    """Return the mean closure of each leg without its largest and smallest.

    In plain numbers: for six legs, numpy's calls take longer.

    Args:
        closure_rel: Closures over the gap [1], shape (legs, 9), NaN where there is none.

    Returns:
        Mean of each leg [1]; NaN for a leg with fewer than three closures.

    Example:
        >>> middle_mean(np.array([[0.0, 1.0, 2.0, 9.0, np.nan]]))
        [1.5]
    """
    means_rel = []
    for closures_rel in closure_rel.tolist():
        known = closures_rel
        if not math.isfinite(sum(closures_rel)):
            known = [closure for closure in closures_rel if math.isfinite(closure)]
        known.sort()
        means_rel.append(sum(known[1:-1]) / (len(known) - 2) if len(known) > 2 else math.nan)
    return means_rel


class Contact:
    """Whether one leg is on the ground. Plain numbers: six times these are cheaper than arrays of six.

    Attributes:
        limits: When a foot is on the ground.
        touching: Whether it is; False where that is not known.
        load_n: Load along the leg above its zero [N], NaN where it is not known.
        doubt_n: How much of a load drift and creep alone could explain now [N].
    """

    def __init__(self, limits: ContactLimits) -> None:
        self.limits = limits
        self._touch_n, self._lift_n = limits.touch_n, limits.lift_n
        self._carried_n = 0.0
        self.doubt_n = 0.0
        self.begin_anew(0)

    def begin_anew(self, t_ns: int) -> None:
        """Forget what was: at `t_ns` [ns] the leg has got a new zero, or has not been heard for long."""
        self.touching = False
        self.load_n = math.nan
        self._floor_n = 0.0
        self._recent_n = 0.0
        # The highest load of the last _LOW_NS to twice that.
        self._highest_before_n = self._highest_n = math.inf
        self._watched_ns = t_ns
        self._t_ns = self._lifted_ns = t_ns
        self._foreseen_ns = t_ns - _FORESEEN_NS

    def observe(
        self, load_n: float, zero_doubt_n: float, t_ns: int, now_ns: int, foreseen_n: float = math.nan
    ) -> None:
        """Judge the newest load.

        Args:
            load_n: Load along the leg above its zero [N], NaN where it is not known.
            zero_doubt_n: How far the zero may be off [N].
            t_ns: When the newest of the readings was taken [ns].
            now_ns: The time now [ns].
            foreseen_n: The same load as predicted from the newest reading, which shows a touchdown before most elements
                have been read again [N]; NaN without a prediction.
        """
        self.load_n = load_n
        if not math.isfinite(load_n):
            if now_ns - self._t_ns > _BELIEVED_NS:
                self.begin_anew(now_ns)
            return
        passed_s = (t_ns - self._t_ns) * 1e-9 if t_ns > self._t_ns else 0.0
        self._t_ns = t_ns
        self.doubt_n = doubt_n = zero_doubt_n + _CREEP_REL * self._carried_n
        floor_n = self._floor_n
        above_n = load_n - floor_n
        if self.touching:
            lift_n = self._lift_n
            # Against a floor below the zero a foot might never be free: the zero is in the air too.
            fell = load_n < _FALLEN_REL * self._recent_n and load_n - max(floor_n, 0.0) < lift_n + doubt_n
            # What was foreseen is held: the elements that show it have yet to be read.
            if (fell or above_n < lift_n) and t_ns - self._foreseen_ns >= _FORESEEN_NS:
                self.touching = False
                self._lifted_ns = t_ns
                # A foot can be pressed, not pulled: what lies farther below than its zero may be off is the end of a
                # parabola through the lift-off, and a floor there would take the next reading for a touchdown.
                self._floor_n = max(load_n, -zero_doubt_n)
                self._highest_before_n = self._highest_n = self._floor_n
                self._watched_ns = t_ns
        elif above_n > self._touch_n:
            self.touching = True
        elif foreseen_n - floor_n > self._touch_n and t_ns - self._lifted_ns > _RINGS_NS:
            self.touching = True
            self._foreseen_ns = t_ns
        else:
            if t_ns - self._watched_ns > _LOW_NS:
                self._highest_before_n = self._highest_n
                self._highest_n, self._watched_ns = load_n, t_ns
            self._highest_n = max(self._highest_n, load_n)
            highest_n = max(self._highest_n, self._highest_before_n)
            self._floor_n = min(highest_n, floor_n + self.limits.floor_n_per_s * passed_s)
        pressed_n = max(load_n, 0.0)
        self._recent_n += (pressed_n - self._recent_n) * (passed_s / (_RECENT_S + passed_s))
        self._carried_n += (pressed_n - self._carried_n) * (passed_s / (_CARRIED_S + passed_s))

    @property
    def aloft(self) -> bool:
        """Whether the swing is confirmed: off the ground for a while, and not about to touch."""
        return (
            not self.touching
            and self.load_n - self._floor_n < self._lift_n / 2
            and (self._t_ns - self._lifted_ns) * 1e-9 >= self.limits.confirmed_s
        )

    @property
    def explained(self) -> bool:
        """Whether drift and creep could explain the whole load; False where that is not known."""
        return abs(self.load_n) <= self._lift_n + self.doubt_n

    def refusal(self, kind: CommandKind) -> str | None:
        """Return why a command may not be obeyed now, or None if it may."""
        return refusal(kind, touching=self.touching, load_n=self.load_n, doubt_n=self.doubt_n)


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
    carries = "its load is not known now" if math.isnan(load_n) else f"it carries {load_n:.2f} N"
    doubt = f", and drift explains at most {doubt_n:.2f} N" if kind is CommandKind.TARE else ""
    return f"the foot is on the ground: {carries}{doubt}"
