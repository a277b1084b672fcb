"""Clock synchronisation: offset and drift of a microcontroller's or sensor's clock against this machine's.

A message is stamped by the sender and again on arrival: the second stamp minus the first is the offset of the clocks
plus the delay. The delay varies with interrupts, buffers and scheduling, but is never negative. So the smallest offsets
count: the highest line below all of them is the offset and its drift.

Of the lines below all points, the one with the smallest mean distance is the edge of their lower convex hull at the
points' mean time. The smallest delay itself cannot be observed from one end and remains: a mapped time is late by it.

Source:
    S. Moon, P. Skelly and D. Towsley, Estimation and removal of clock skew from network delay measurements, INFOCOM
    1999: posed as a linear program, whose solution is that edge.
"""

from collections import deque

_NS_PER_MS = 1_000_000

#: Slot of which only the smallest offset is kept [ns]: a tenth of a second has short delays in any stream in use.
_SLOT_DURATION_NS = 100 * _NS_PER_MS
#: Window of the fit [ns]: a crystal that warms up stays within 1 ppm over it.
_FIT_WINDOW_NS = 10_000 * _NS_PER_MS
#: Smallest span of a slope [ns]: below it the delays dominate.
_MIN_FIT_SPAN_NS = 500 * _NS_PER_MS
#: Largest drift with which a serial line still works [1]: an RC oscillator, 1 %.
_MAX_DRIFT_REL = 0.01
#: Stamps of one scan arrive out of order by less than this [ns].
_MAX_REORDERING_NS = 20 * _NS_PER_MS
#: A delay below the smallest by this much is a jump of the clock, and so is one above it for all of
#: `_JUMP_CONFIRMATION_NS` [ns].
_MIN_JUMP_NS = 20 * _NS_PER_MS
_JUMP_CONFIRMATION_NS = 1_000 * _NS_PER_MS

_OffsetPoint = tuple[int, int]  # foreign time and offset [ns]


class ClockMap:
    """Estimates offset and drift of one foreign clock, and maps its time stamps to this machine's clock.

    A jump restarts the estimate: at once if the clock jumps back or ahead by more than 20 ms, and after a second if it
    stood still, since until then the messages may just be delayed.

    Attributes:
        restarts: Number of jumps. Within the first half second, when buffers may hold old bytes, only a leap ahead by
            half a second more than has passed here counts.
        drift_rel: Rate of this machine's clock over the foreign one, minus 1 [1], -0.01 to 0.01; 0 at first.
    """

    def __init__(self) -> None:
        self.restarts = 0
        self.drift_rel = 0.0
        self._points: deque[_OffsetPoint] = deque()
        self._least: _OffsetPoint | None = None  # of the current slot
        self._origin: _OffsetPoint = (0, 0)  # the line goes through it
        self._lowered_ns = 0  # since the last fit
        self._slot_ends_ns = 0
        self._late_since_ns: int | None = None
        self._last: tuple[int, int] | None = None  # foreign time and its mapped time
        self._arrived_ns = 0  # time of the last arrival

    @property
    def mean_residual_ns(self) -> int:
        """Mean distance of the smallest clock offsets from the fitted straight line [ns]: error of a mapped time."""
        if not self._points:
            return 0
        return sum(y_ns - self._fitted_offset_ns(x_ns) for x_ns, y_ns in self._points) // len(self._points)

    def map(self, t_foreign_ns: int, t_arrival_ns: int) -> int:
        """Return a foreign time stamp in this machine's monotonic clock [ns].

        The result is never later than the arrival, and monotonic where the foreign clock is: a map that turns out to be
        ahead is corrected at half the speed.

        Args:
            t_foreign_ns: The stamp [ns], any start; a counter that wraps is the caller's to unwrap.
            t_arrival_ns: When it was received [ns], never before that of the call before.
        """
        point = (t_foreign_ns, t_arrival_ns - t_foreign_ns)
        late_ns = point[1] - self._fitted_offset_ns(t_foreign_ns)
        since_ns = 0 if self._last is None else t_foreign_ns - self._last[0]
        waited_ns = t_arrival_ns - self._arrived_ns
        if self._last is None or self._has_jumped(since_ns, late_ns, t_arrival_ns):
            self._restart(point, t_arrival_ns, leapt=since_ns - waited_ns > _MIN_FIT_SPAN_NS)
            mapped_ns = t_arrival_ns
        else:
            slowest_ns = self._last[1] + (since_ns // 2 if since_ns > 0 else since_ns)
            mapped_ns = min(max(t_arrival_ns - max(late_ns, 0), slowest_ns), t_arrival_ns)
            self._add_point(point, late_ns, t_arrival_ns)
        self._last = t_foreign_ns, mapped_ns
        self._arrived_ns = t_arrival_ns
        return mapped_ns

    def _fitted_offset_ns(self, t_foreign_ns: int) -> int:
        """Return the fitted clock offset at a foreign time [ns]."""
        return self._origin[1] + round(self.drift_rel * (t_foreign_ns - self._origin[0]))

    def _has_jumped(self, since_ns: int, late_ns: int, t_arrival_ns: int) -> bool:
        """Return whether the foreign clock has jumped or restarted."""
        if late_ns <= _MIN_JUMP_NS:
            self._late_since_ns = None
        elif self._late_since_ns is None:
            self._late_since_ns = t_arrival_ns
        stood_still = (
            self._late_since_ns is not None and t_arrival_ns - self._late_since_ns > _JUMP_CONFIRMATION_NS
        )
        # Reading a backlog lowers the line little by little, and its slope with it.
        return stood_still or late_ns - self._lowered_ns < -_MIN_JUMP_NS or since_ns < -_MAX_REORDERING_NS

    def _restart(self, point: _OffsetPoint, t_arrival_ns: int, *, leapt: bool) -> None:
        """Restart the estimate of offset and drift from one point."""
        is_known = self._points and self._points[-1][0] - self._points[0][0] >= _MIN_FIT_SPAN_NS
        if is_known or leapt:
            self.restarts += 1
        self.drift_rel = 0.0
        self._points.clear()
        self._least = self._origin = point
        self._late_since_ns = None
        self._lowered_ns = 0
        self._slot_ends_ns = t_arrival_ns + _SLOT_DURATION_NS

    def _add_point(self, point: _OffsetPoint, late_ns: int, t_arrival_ns: int) -> None:
        """Add an offset sample; at the end of a time slot, store its smallest one and fit again."""
        if late_ns < 0:
            self._lowered_ns -= late_ns
            self._origin, late_ns = point, 0
        if self._least is None or late_ns < self._least[1] - self._fitted_offset_ns(self._least[0]):
            self._least = point
        if t_arrival_ns < self._slot_ends_ns:
            return
        self._points.append(self._least)
        self._least = None
        self._slot_ends_ns = t_arrival_ns + _SLOT_DURATION_NS
        while len(self._points) > 1 and sum(self._points[0]) < t_arrival_ns - _FIT_WINDOW_NS:
            self._points.popleft()
        self._fit_line()

    def _fit_line(self) -> None:
        """Fit offset and drift: the straight line below all offset samples."""
        self._lowered_ns = 0
        points = sorted(self._points)
        if points[-1][0] - points[0][0] >= _MIN_FIT_SPAN_NS:
            slope_rel = _lower_hull_slope(points)
            self.drift_rel = min(max(slope_rel, -_MAX_DRIFT_REL), _MAX_DRIFT_REL)
        self._origin = min(points, key=lambda point: point[1] - self.drift_rel * (point[0] - points[0][0]))


def _lower_hull_slope(points: list[_OffsetPoint]) -> float:
    """Return the slope of the lower convex hull at the mean time of sorted points (not all of one time).

    Example:
        >>> _lower_hull_slope([(0, 0), (10, 7), (20, 2), (30, 9), (40, 4)])
        0.1
    """
    hull: list[_OffsetPoint] = []
    for x, y in points:
        while len(hull) > 1 and _is_clockwise(hull[-2], hull[-1], (x, y)):
            hull.pop()
        if hull and hull[-1][0] == x:  # the lower one of two at one time, as they are sorted
            continue
        hull.append((x, y))
    mean = sum(x for x, _ in points) / len(points)
    right = next(i for i, (x, _) in enumerate(hull) if x >= mean)
    (x0, y0), (x1, y1) = hull[right - 1], hull[right]
    return (y1 - y0) / (x1 - x0)


def _is_clockwise(a: _OffsetPoint, b: _OffsetPoint, c: _OffsetPoint) -> bool:
    """Return whether the turn from one point over the second to the third is clockwise, or there is none."""
    return (b[0] - a[0]) * (c[1] - a[1]) <= (b[1] - a[1]) * (c[0] - a[0])
