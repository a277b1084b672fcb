"""Find the longest span of a press in which force and every capacitance stay within their tolerances.

The limit of a range is that of the span's last scan, and a range only grows with its span. So the first scan of the
longest span that ends at a scan never moves back from one scan to the next: running extremes find it in one pass.
"""

import math
from collections import deque

import numpy as np

from footsense.frames import Stamps, Vector


def longest_steady_scan_range(
    t_ns: Stamps,
    force_n: Vector,
    change_pf: Vector,
    force_tolerance_n: Vector,
    capacitance_tolerance_pf: Vector,
) -> tuple[int, int]:
    """Return the first and last scan index of the longest constant span; the same index if there is none.

    Args:
        t_ns: Time of each scan [ns], shape (scans,), at least one.
        force_n: Reference force about each [N], shape (scans, 3); no span contains a NaN.
        change_pf: Change of each element [pF], shape (scans, 9); NaN, not read, is ignored.
        force_tolerance_n: Largest range of the force in a span that ends at each scan [N], shape (scans, 3).
        capacitance_tolerance_pf: The same of the elements [pF], shape (scans, 9); NaN for no limit.
    """
    scans = np.arange(len(t_ns))
    unknown = np.isnan(force_n).any(axis=1)
    first = np.minimum(np.maximum.accumulate(np.where(unknown, scans + 1, 0)), scans)
    values, limits = np.hstack([force_n, change_pf]), np.hstack([force_tolerance_n, capacitance_tolerance_pf])
    for value, limit in zip(values.T, limits.T, strict=True):
        first = np.maximum(first, _steady_span_starts(value.tolist(), limit.tolist()))
    last = int(np.argmax(t_ns - t_ns[first]))
    return int(first[last]), last


def _steady_span_starts(values: list[float], limits: list[float]) -> list[int]:
    """Return, per scan, the first scan since which the values' range is within its limit; NaN is ignored.

    Example:
        >>> _steady_span_starts([0.0, 1.0, 5.0, 5.5], [1.0, 1.0, 1.0, 1.0])
        [0, 0, 2, 2]
    """
    # The values that can still become the largest, or the smallest, of the span; the first one is it now.
    largest, smallest = deque[tuple[int, float]](), deque[tuple[int, float]]()
    first, since = 0, []
    for scan, (value, limit) in enumerate(zip(values, limits, strict=True)):
        if not math.isnan(value):
            while largest and largest[-1][1] <= value:
                largest.pop()
            while smallest and smallest[-1][1] >= value:
                smallest.pop()
            largest.append((scan, value))
            smallest.append((scan, value))
        while largest and largest[0][1] - smallest[0][1] > limit:
            older = largest if largest[0][0] < smallest[0][0] else smallest
            first = older.popleft()[0] + 1
        since.append(first)
    return since
