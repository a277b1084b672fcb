r"""Whether a foot's calibration still holds, judged while the robot walks; no force is ever changed by it.

Two things tell, stride by stride, a stride being the time between two touchdowns of the first leg:

**Loads.** Over a stride of a steady walk, the mean loads of all legs add up to the weight. A walk that leans, turns or
limps only moves load from leg to leg; a payload or a temperature changes all legs alike. What one leg reads
differently, while no other leg reads the opposite, is its calibration: with d_i the change of leg i beyond the common
factor (the median over the legs), and D the sum of all d, a leg is blamed for the smaller one of d_i and D, if both
have the same sign. So one or two of six feet that became softer or stiffer are found. Three cannot be told from the
other three; all together, and a payload, show in the sum alone, which is held against the body weight if that is
known, else against what it was at first.

**Elements.** A foot that yields more evenly contradicts itself no more than before, and its sigma is as wrong as its
force. One whose elements age apart does: the residuals that `consistency` knows, over the closures, rise above what
they were, and sigma, which was trained without that, no longer covers the error.

Each is summed up as in Page's test: S <- max(0, S + x - slack), alarm at S >= limit, over when S is back at 0; S stays
below the limit, so that it always comes back. In strides between two false alarms (Siegmund 1985, eq. 2.57),

    (exp(2 D b) - 1 - 2 D b) / (2 D^2),   D = slack / s,   b = limit / s + 1.166,

for changes x that scatter by s from stride to stride. What was learnt in 100 strides is off by up to s / 5, taken off
the slack:

| test | x | slack | limit | scatter s | false alarms, one in | found |
|---|---|---|---|---|---|---|
| a leg's load | change [1] | 0.04 | 1.0 | 0.06 | 3e7 strides of a leg, either way | 15 % softer: 10 strides |
| the sum | change [1] | 0.12 | 0.8 | 0.1 | 4e7 strides, either way | all 20 % softer: 10 strides |
| elements | logarithm of the ratio [1] | 0.4 | 2.0 | 0.3 | 1e7 strides of a leg | twice: 8 strides |

Loads that scatter by a tenth, each for itself, make x scatter by 0.06, and hide a part of a change: half of 15 % is
left, which is found in 32 strides; where they scatter by 5 %, in 20.

20 K change the stiffness by 8.8 %: all loads by -8.1 % or +9.6 %. No single leg is blamed for that, and the sum's slack
lies above it. A foot that alone is as much warmer than the others is blamed: it does read that much too little.
"""

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Strides after which it is known what is usual.
LEARNT_STRIDES = 100
LOAD_SLACK, LOAD_LIMIT = 0.04, 1.0
SUM_SLACK, SUM_LIMIT = 0.12, 0.8
ELEMENTS_SLACK, ELEMENTS_LIMIT = 0.4, 2.0

#: How often the forces are looked at: a stance has ten times as long.
LOOK_NS = 40_000_000
#: After so long without a look, nothing is known of what was between.
_GAP_NS = 200_000_000
_SHORTEST_NS, _LONGEST_NS = 200_000_000, 5_000_000_000
#: With fewer legs, none is common: a bench is no walk.
_FEWEST_LEGS = 4
_NEVER_NS = 1 << 62


class Ageing:
    """Watches the legs of a robot that walks.

    Args:
        n_legs: Legs in a frame; fewer than four are never judged.
        body_weight_n: What all legs carry together, along their axes [N]; None if that is not known.

    Attributes:
        stale: Legs whose calibration is in doubt, shape (legs,); replaced, never changed.
        in_doubt: Whether there are any.
        due_ns: When the forces are to be looked at again [ns].
    """

    def __init__(self, n_legs: int, body_weight_n: float | None = None) -> None:
        self._watches = n_legs >= _FEWEST_LEGS
        self._strides = _Strides(n_legs, body_weight_n)
        self.stale: Mask = np.zeros(n_legs, bool)
        self.in_doubt = False
        self.due_ns = 0 if self._watches else _NEVER_NS
        self._t_ns = self._since_ns = 0
        self._first_down = True
        # Of this stride so far.
        self._impulse_ns = np.zeros(n_legs)
        self._squares = np.zeros((n_legs, 2))
        self._n_down = np.zeros(n_legs)
        self._n_looks = 0

    def look(self, load_n: Vector, on_ground: Mask, squares: Vector, now_ns: int) -> None:
        """Take note of the forces of a frame, and judge the stride if one ends with it.

        Args:
            load_n: Force along the leg [N], shape (legs,), NaN where it is not known: such a stride is not judged.
            on_ground: Whether the foot touches, shape (legs,).
            squares: Sum of the squares of what the elements contradict each other, and of their closures [1], shape
                (legs, 2); in the air both are next to nothing.
            now_ns: The time now [ns].
        """
        passed_ns = now_ns - self._t_ns
        self._t_ns, self.due_ns = now_ns, now_ns + LOOK_NS
        first_down = bool(on_ground[0])
        if first_down and not self._first_down:
            self._end(now_ns)
        self._first_down = first_down
        if passed_ns > _GAP_NS:
            self._impulse_ns[:] = np.nan
            return
        self._impulse_ns += load_n * passed_ns
        self._squares += squares
        self._n_down += on_ground
        self._n_looks += 1

    def _end(self, now_ns: int) -> None:
        """Judge the stride that ends now, if it was one of a walk in which every force was known."""
        lasted_ns, self._since_ns = now_ns - self._since_ns, now_ns
        load_n, (contradicted2, closed2) = self._impulse_ns / lasted_ns, self._squares.T.copy()
        # A leg that never left the ground, or never touched it, does not walk.
        walked = self._n_down.min() > 0 and self._n_down.max() < self._n_looks
        self._impulse_ns[:], self._squares[:], self._n_down[:], self._n_looks = 0.0, 0.0, 0.0, 0
        if not (walked and _SHORTEST_NS <= lasted_ns <= _LONGEST_NS):
            return
        # A NaN is no load above 0 either.
        if not (load_n.min() > 0.0 and closed2.min() > 0.0):
            return
        self.stale = self._strides.judge(load_n, np.sqrt(contradicted2 / closed2))
        self.in_doubt = bool(self.stale.any())


class _Strides:
    """What strides tell, one after the other."""

    def __init__(self, n_legs: int, body_weight_n: float | None) -> None:
        self._body_weight_n = body_weight_n
        self._n_learnt = 0
        self._usual_n = np.zeros(n_legs)
        self._usual_log = np.zeros(n_legs)
        # More, less, and contradicting more; of the whole robot more and less.
        self._legs = _Tests(
            np.array([LOAD_SLACK, LOAD_SLACK, ELEMENTS_SLACK])[:, None],
            np.array([LOAD_LIMIT, LOAD_LIMIT, ELEMENTS_LIMIT])[:, None],
            (3, n_legs),
        )
        self._sum = _Tests(SUM_SLACK, SUM_LIMIT, (2,))

    def judge(self, load_n: Vector, contradiction_rel: Vector) -> Mask:
        """Return the legs whose calibration is in doubt, shape (legs,).

        Args:
            load_n: Mean load of each leg over a stride, each above 0 [N].
            contradiction_rel: Root mean square of the residuals over that of the closures [1].
        """
        learnt = self._n_learnt == LEARNT_STRIDES
        if not learnt:
            self._n_learnt += 1
            share = 1 / self._n_learnt
            self._usual_n += share * (load_n - self._usual_n)
            self._usual_log += share * (np.log(contradiction_rel + _NO_CONTRADICTION) - self._usual_log)
        else:
            changed_rel = blamed_rel(load_n, self._usual_n)
            grown = np.log(contradiction_rel + _NO_CONTRADICTION) - self._usual_log
            self._legs.add(np.stack([changed_rel, -changed_rel, grown]))
        weight_n = self._body_weight_n or (float(self._usual_n.sum()) if learnt else None)
        if weight_n is not None:
            more_rel = float(load_n.sum()) / weight_n - 1.0
            self._sum.add(np.array([more_rel, -more_rel]))
        stale: Mask = np.logical_or(self._legs.alarm.any(axis=0), self._sum.alarm.any())
        return stale


#: Keeps the logarithm finite for a simulation without any noise [1].
_NO_CONTRADICTION = 1e-3


class _Tests:
    """Page's tests, many at once.

    Args:
        slack: What is no change.
        limit: From which sum on there is an alarm.
        shape: Of the tests.
    """

    def __init__(self, slack: Vector | float, limit: Vector | float, shape: tuple[int, ...]) -> None:
        self._slack, self._limit = slack, limit
        self._sum = np.zeros(shape)
        self.alarm: Mask = np.zeros(shape, bool)

    def add(self, change: Vector) -> None:
        """Take one more change."""
        self._sum = np.clip(self._sum + change - self._slack, 0.0, self._limit)
        self.alarm = (self._sum >= self._limit) | (self.alarm & (self._sum > 0.0))


def blamed_rel(load_n: Vector, usual_n: Vector) -> Vector:
    """Return by how much each leg reads too much or too little, as far as only its calibration explains it [1].

    Args:
        load_n: Mean load of each leg, shape (legs,) [N].
        usual_n: What it was, each above 0 [N].

    Example:
        >>> usual_n = np.full(6, 0.5)
        >>> softer, turns = usual_n.copy(), usual_n.copy()
        >>> softer[1] *= 1.2
        >>> turns[:3], turns[3:] = 0.4, 0.6
        >>> blamed_rel(softer, usual_n).round(3).tolist()
        [0.0, 0.2, 0.0, 0.0, 0.0, 0.0]
        >>> [bool(blamed_rel(load_n, usual_n).any()) for load_n in (turns, 1.5 * usual_n)]
        [False, False]
    """
    change_n = load_n - np.median(load_n / usual_n) * usual_n
    total_n = change_n.sum()
    alone_n = np.where(change_n * total_n > 0.0, np.minimum(np.abs(change_n), abs(total_n)), 0.0)
    rel: Vector = np.sign(total_n) * alone_n / usual_n
    return rel
