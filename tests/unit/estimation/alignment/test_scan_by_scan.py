"""Scans of several legs that are averaged: each leg has times and values of its own."""

import numpy as np

from footsense.estimation.alignment.scan_by_scan import ScanByScan
from tests.support.feet import SumOfClosures

PERIOD_NS = 22_500_000
STEP_NS = PERIOD_NS // 9
#: Position of each element in the scan of each leg: neither begins with its first element.
POSITIONS = np.array([[4, 5, 6, 7, 8, 0, 1, 2, 3], [8, 7, 6, 5, 4, 3, 2, 1, 0]])
#: The second leg is read later [ns].
AFTER_NS = np.array([700_000, 1_900_000])
NONE_MISSING = np.zeros((2, 9), bool)


def test_a_mean_of_two_scans_is_of_their_mean_time_and_as_old_as_the_older_one() -> None:
    """Leg by leg; a leg without one of the two is not of one time, and the other is."""
    scans = ScanByScan(SumOfClosures(), 2, np.eye(9), n_averaged=2)
    slope_per_s = np.array([[0.3], [-0.2]]) * np.arange(1.0, 10.0)
    for n in range(8):
        begins_ns = 1_000_000_000 + n * PERIOD_NS + AFTER_NS
        t_ns = begins_ns[:, None] + POSITIONS * STEP_NS
        distance_rel = 1.0 + slope_per_s * (t_ns * 1e-9)
        if n == 6:
            distance_rel[1, 3] = np.nan
        sample = scans.align(distance_rel, t_ns, 0, NONE_MISSING)
        oldest_ns, n_averaged = (begins_ns, 1) if n == 0 else (begins_ns - PERIOD_NS, 2)
        assert sample.measured_rel is None
        assert sample.oldest_ns.tolist() == oldest_ns.tolist()
        middle_ns = oldest_ns + 4 * STEP_NS + (n_averaged - 1) * PERIOD_NS // 2
        assert sample.t_ns.tolist() == middle_ns.tolist()
        assert sample.time_aligned.tolist() == [n >= 2, 2 <= n < 6]
        if n >= 2:
            true_rel = 1.0 + slope_per_s * (middle_ns[:, None] * 1e-9)
            aligned = sample.time_aligned
            np.testing.assert_allclose(sample.distance_rel[aligned], true_rel[aligned], rtol=1e-9)
