"""Elements of one scan brought to one time: exact for motions that bend, refused for scans that stalled."""

import numpy as np
import pytest
from numpy.typing import NDArray

from footsense.estimation.alignment.scan_by_scan import AlignedScan, SkewRemoval

PERIOD_NS = 22_500_000
STEP_NS = PERIOD_NS // 9


def scan_t_ns(number: int) -> NDArray[np.int64]:
    """Return the stamps of a scan of nine even steps, shape (1, 9)."""
    return (number * PERIOD_NS + STEP_NS * np.arange(9))[None]


def aligned(n_scans: int, stall_ns: int = 0) -> tuple[AlignedScan, NDArray[np.float64]]:
    """Return the last of some scans, before whose last element the bus stalls, and the true values at its time."""
    skew = SkewRemoval(1, 9)
    for number in range(n_scans):
        t_ns = scan_t_ns(number)
        t_ns[0, 8] += stall_ns if number == n_scans - 1 else 0
        scan = skew.apply(motion(t_ns), t_ns)
    return scan, motion(np.repeat(scan.t_ns[:, None], 9, axis=1))


def motion(t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return a load that grows with the square of time, and differs from element to element."""
    t_s = t_ns * 1e-9
    return np.arange(1.0, 10.0) * (1.0 + 3.0 * t_s - 20.0 * t_s**2)


@pytest.mark.parametrize("stall_ns", [0, 20_000_000, 45_000_000])
def test_what_bends_comes_out_exact(stall_ns: int) -> None:
    """From the third scan on, also where one element came late by up to two scans."""
    scan, true = aligned(3, stall_ns)
    assert scan.time_aligned.all()
    np.testing.assert_allclose(scan.values, true, rtol=1e-9)


@pytest.mark.parametrize("stall_ns", [80_000_000, 120_000_000, 400_000_000])
def test_a_scan_that_stalled_is_not_of_one_time(stall_ns: int) -> None:
    """An element farther from the middle than three quarters of its period cannot be moved there."""
    assert not aligned(3, stall_ns)[0].time_aligned.any()


def test_two_scans_make_a_line_and_one_makes_nothing() -> None:
    """The first scan is of no one time."""
    assert not aligned(1)[0].time_aligned.any()
    scan, true = aligned(2)
    assert scan.time_aligned.all()
    assert np.abs(scan.values - true).max() > 1e-4
