"""The longest steady span is found in one pass, and is the one that looking at every span finds."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from footsense.calibration.loads.steady_span import longest_steady_scan_range

Vector = NDArray[np.float64]

#: Some steps of a tenth, or no value.
values = st.sampled_from([math.nan, *(0.1 * step for step in range(12))])
rows = st.lists(st.tuples(*[values] * 6), min_size=1, max_size=40)
#: No sum of steps, so that no range is at its limit.
limits = st.sampled_from([0.013, 0.157, 0.3331, 0.77])


def slowly(
    t_ns: Vector, force_n: Vector, change_pf: Vector, limit_n: Vector, limit_pf: Vector
) -> tuple[int, int]:
    """Return the same by the ranges of every span anew."""
    best, first = (0, 0), 0
    for last in range(len(t_ns)):
        while first < last and not is_steady(
            force_n[first : last + 1], change_pf[first : last + 1], limit_n[last], limit_pf[last]
        ):
            first += 1
        if t_ns[last] - t_ns[first] > t_ns[best[1]] - t_ns[best[0]]:
            best = first, last
    return best


def is_steady(force_n: Vector, change_pf: Vector, limit_n: Vector, limit_pf: Vector) -> bool:
    """Tell whether force and capacitance stand still; NaN among the forces does not."""
    if not (np.ptp(force_n, axis=0) <= limit_n).all():
        return False
    moved_pf = np.fmax.reduce(change_pf, axis=0) - np.fmin.reduce(change_pf, axis=0)
    return not (moved_pf > limit_pf).any()


@settings(max_examples=300)
@given(
    rows,
    st.lists(st.tuples(limits, st.one_of(limits, st.just(math.nan))), min_size=40, max_size=40),
    st.data(),
)
def test_one_pass_finds_what_looking_at_every_span_does(
    values: list[tuple[float, ...]], limits: list[tuple[float, float]], data: st.DataObject
) -> None:
    """Whatever moves, is not read, or may move by how much."""
    n = len(values)
    steps_ns = data.draw(st.lists(st.integers(1, 50), min_size=n, max_size=n))
    t_ns = np.cumsum(steps_ns)
    force_n, change_pf = np.hsplit(np.array(values), [3])
    limit_n, limit_pf = (np.repeat(column, 3, axis=1) for column in np.hsplit(np.array(limits[:n]), 2))
    given_ = (force_n, change_pf, limit_n, limit_pf)
    assert longest_steady_scan_range(t_ns, *given_) == slowly(t_ns, *given_)
