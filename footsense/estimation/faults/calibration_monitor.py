r"""Calibration monitor: CUSUM tests that detect stale calibrations during walking; they change no force.

Two signals are tested stride by stride, a stride being the time between two touchdowns of the first leg:

**Loads.** Over a stride of a steady walk, the mean loads of all legs add up to the weight. A walk that leans, turns or
limps only moves load from leg to leg; a payload or a temperature changes all legs alike. A change of one leg without
the opposite change of another is its calibration: with d_i the change of leg i beyond the common factor (the median
over the legs), and D the sum of all d, the smaller one of d_i and D is attributed to leg i, if both have the same sign.
So one or two of six feet that became softer or stiffer are found. Three cannot be told from the other three; all
together, and a payload, show in the sum alone, which is compared with the body weight if that is configured, else with
its first mean.

**Elements.** A foot that becomes softer evenly stays consistent, and its sigma is as wrong as its force. One whose
elements age apart does not: the residuals of `consistency.py` over the closures rise above their first mean, and sigma,
which was trained without that, no longer covers the error.

Each is summed as in Page's CUSUM test: S <- max(0, S + x - slack), alarm at S >= limit, over when S is back at 0; S is
clipped to the limit, so that the alarm can end. In strides between two false alarms (Siegmund 1985, eq. 2.57),

    (exp(2 D b) - 1 - 2 D b) / (2 D^2),   D = slack / s,   b = limit / s + 1.166,

for changes x with a standard deviation s over the strides. The mean of the first 100 strides is off by up to s / 5,
which is subtracted from the slack:

| test | x | slack | limit | s | false alarms, one in | found |
|---|---|---|---|---|---|---|
| a leg's load | change [1] | 0.04 | 1.0 | 0.06 | 3e7 strides of a leg, either way | 15 % softer: 10 strides |
| the sum | change [1] | 0.12 | 0.8 | 0.1 | 4e7 strides, either way | all 20 % softer: 10 strides |
| elements | logarithm of the ratio [1] | 0.4 | 2.0 | 0.3 | 1e7 strides of a leg | twice: 8 strides |

Loads with independent standard deviations of 10 % give x one of 0.06, and hide a part of a change: half of 15 % is
left, which is found in 32 strides; with 5 %, in 20.

20 K change the stiffness by 8.8 %: all loads by -8.1 % or +9.6 %. None of that is attributed to a single leg, and
the slack of the sum lies above it. A foot that alone is that much warmer is reported: it does read that much too low.
"""

import numpy as np

from footsense.frames import Mask, Vector

#: Strides over which the references are averaged.
REFERENCE_STRIDES = 100
LOAD_SLACK, LOAD_LIMIT = 0.04, 1.0
SUM_SLACK, SUM_LIMIT = 0.12, 0.8
ELEMENTS_SLACK, ELEMENTS_LIMIT = 0.4, 2.0

#: Sampling period of the forces [ns], a tenth of a stance.
SAMPLING_PERIOD_NS = 40_000_000
#: Largest gap between samples of a stride that is tested [ns].
_MAX_SAMPLE_GAP_NS = 200_000_000
_SHORTEST_STRIDE_NS, _LONGEST_STRIDE_NS = 200_000_000, 5_000_000_000
#: With fewer legs there is no common factor: a test stand is no walk.
_MIN_LEGS = 4
_NEVER_NS = 1 << 62


class CalibrationMonitor:
    """Tests the calibration of every foot while the robot walks, stride by stride.

    Args:
        n_legs: Legs in a frame; fewer than four are never tested.
        body_weight_n: Load of all legs together, along their axes [N]; None if not configured.

    Attributes:
        stale: Legs with an alarm, shape (legs,); replaced, never written to.
        any_stale: Whether there are any.
        due_ns: Time of the next sample [ns].
    """

    def __init__(self, n_legs: int, body_weight_n: float | None = None) -> None:
        self._enabled = n_legs >= _MIN_LEGS
        self._tests = _StrideTests(n_legs, body_weight_n)
        self.stale: Mask = np.zeros(n_legs, bool)
        self.any_stale = False
        self.due_ns = 0 if self._enabled else _NEVER_NS
        self._t_ns = self._since_ns = 0
        self._first_in_contact = True
        # Of this stride so far.
        self._impulse_ns = np.zeros(n_legs)
        self._squares = np.zeros((n_legs, 2))
        self._n_contact = np.zeros(n_legs)
        self._n_samples = 0

    def observe(self, load_n: Vector, in_contact: Mask, squares: Vector, now_ns: int) -> None:
        """Integrate the load of each leg; at the first leg's touchdown, test the stride that ends.

        Args:
            load_n: Force along the leg [N], shape (legs,), NaN where it is not known: such a stride is not tested.
            in_contact: Whether the foot is in contact, shape (legs,).
            squares: Sums of squares of the residuals and of the closures [1], shape (legs, 2); in swing both are
                negligible.
            now_ns: Current time [ns].
        """
        elapsed_ns = now_ns - self._t_ns
        self._t_ns, self.due_ns = now_ns, now_ns + SAMPLING_PERIOD_NS
        first_in_contact = bool(in_contact[0])
        if first_in_contact and not self._first_in_contact:
            self._end_stride(now_ns)
        self._first_in_contact = first_in_contact
        if elapsed_ns > _MAX_SAMPLE_GAP_NS:
            self._impulse_ns[:] = np.nan
            return
        self._impulse_ns += load_n * elapsed_ns
        self._squares += squares
        self._n_contact += in_contact
        self._n_samples += 1

    def _end_stride(self, now_ns: int) -> None:
        """Test a completed stride, if the robot walked and every force was known."""
        lasted_ns, self._since_ns = now_ns - self._since_ns, now_ns
        load_n, (residual2, closure2) = self._impulse_ns / lasted_ns, self._squares.T.copy()
        # A leg that was always or never in contact does not walk.
        walked = self._n_contact.min() > 0 and self._n_contact.max() < self._n_samples
        self._impulse_ns[:], self._squares[:], self._n_contact[:], self._n_samples = 0.0, 0.0, 0.0, 0
        if not (walked and _SHORTEST_STRIDE_NS <= lasted_ns <= _LONGEST_STRIDE_NS):
            return
        # A NaN fails as well.
        if not (load_n.min() > 0.0 and closure2.min() > 0.0):
            return
        self.stale = self._tests.add(load_n, np.sqrt(residual2 / closure2))
        self.any_stale = bool(self.stale.any())


class _StrideTests:
    """CUSUM tests of loads and residuals, fed once per stride."""

    def __init__(self, n_legs: int, body_weight_n: float | None) -> None:
        self._body_weight_n = body_weight_n
        self._n_averaged = 0
        self._reference_n = np.zeros(n_legs)
        self._reference_log = np.zeros(n_legs)
        # Per leg: load up, load down, residuals up. Of the sum: load up, load down.
        self._legs = _Cusum(
            np.array([LOAD_SLACK, LOAD_SLACK, ELEMENTS_SLACK])[:, None],
            np.array([LOAD_LIMIT, LOAD_LIMIT, ELEMENTS_LIMIT])[:, None],
            (3, n_legs),
        )
        self._sum = _Cusum(SUM_SLACK, SUM_LIMIT, (2,))

    def add(self, load_n: Vector, residual_rel: Vector) -> Mask:
        """Add a stride; return the mask of the legs with an alarm, shape (legs,).

        Args:
            load_n: Mean load of each leg over a stride, each above 0 [N].
            residual_rel: Root mean square of the residuals over that of the closures [1].
        """
        complete = self._n_averaged == REFERENCE_STRIDES
        if not complete:
            self._n_averaged += 1
            share = 1 / self._n_averaged
            self._reference_n += share * (load_n - self._reference_n)
            self._reference_log += share * (
                np.log(residual_rel + _RESIDUAL_LOG_OFFSET_REL) - self._reference_log
            )
        else:
            changed_rel = calibration_change_rel(load_n, self._reference_n)
            growth = np.log(residual_rel + _RESIDUAL_LOG_OFFSET_REL) - self._reference_log
            self._legs.add(np.stack([changed_rel, -changed_rel, growth]))
        weight_n = self._body_weight_n or (float(self._reference_n.sum()) if complete else None)
        if weight_n is not None:
            more_rel = float(load_n.sum()) / weight_n - 1.0
            self._sum.add(np.array([more_rel, -more_rel]))
        stale: Mask = np.logical_or(self._legs.alarm.any(axis=0), self._sum.alarm.any())
        return stale


#: Keeps the logarithm finite for a simulation without any noise [1].
_RESIDUAL_LOG_OFFSET_REL = 1e-3


class _Cusum:
    """One-sided CUSUM tests (Page), many in parallel.

    Args:
        slack: Change that is tolerated.
        alarm_threshold: Sum that raises the alarm.
        shape: Shape of the tests.
    """

    def __init__(
        self, slack: Vector | float, alarm_threshold: Vector | float, shape: tuple[int, ...]
    ) -> None:
        self._slack, self._alarm_threshold = slack, alarm_threshold
        self._sum = np.zeros(shape)
        self.alarm: Mask = np.zeros(shape, bool)

    def add(self, change: Vector) -> None:
        """Add one change to every CUSUM test."""
        self._sum = np.clip(self._sum + change - self._slack, 0.0, self._alarm_threshold)
        self.alarm = (self._sum >= self._alarm_threshold) | (self.alarm & (self._sum > 0.0))


def calibration_change_rel(load_n: Vector, reference_n: Vector) -> Vector:
    """Return the relative change of each leg's force reading that only its calibration can explain [1], signed.

    Args:
        load_n: Mean load of each leg, shape (legs,) [N].
        reference_n: Mean load of the first strides, each above 0 [N].

    Example:
        >>> reference_n = np.full(6, 0.5)
        >>> softer, turning = reference_n.copy(), reference_n.copy()
        >>> softer[1] *= 1.2
        >>> turning[:3], turning[3:] = 0.4, 0.6
        >>> calibration_change_rel(softer, reference_n).round(3).tolist()
        [0.0, 0.2, 0.0, 0.0, 0.0, 0.0]
        >>> [bool(calibration_change_rel(load_n, reference_n).any()) for load_n in (turning, 1.5 * reference_n)]
        [False, False]
    """
    change_n = load_n - np.median(load_n / reference_n) * reference_n
    total_n = change_n.sum()
    alone_n = np.where(change_n * total_n > 0.0, np.minimum(np.abs(change_n), abs(total_n)), 0.0)
    change_rel: Vector = np.sign(total_n) * alone_n / reference_n
    return change_rel
