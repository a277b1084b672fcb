"""A foot at rest: the same reading three times, as old as readings of a walking robot are."""

import numpy as np

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.estimation.network import STEADY_AGES_S, steady_windows


def test_a_foot_at_rest_has_read_the_same_three_times() -> None:
    """Every reading of a row is its closure, and nothing is missing unless named."""
    closure_rel = np.random.default_rng(1).random((4, 9))
    missing = np.eye(4, 9, dtype=bool)
    window = steady_windows(closure_rel, missing)
    for reading in range(3):
        np.testing.assert_array_equal(window.closure_rel[:, reading], closure_rel)
        np.testing.assert_array_equal(window.age_s[:, reading], np.tile(STEADY_AGES_S[reading], (4, 1)))
    np.testing.assert_array_equal(window.missing, missing)
    assert not steady_windows(closure_rel).missing.any()
    assert steady_windows(closure_rel).missing.dtype == bool


def test_its_ages_are_those_at_the_end_of_a_scan() -> None:
    """In the order in which a robot reads them, one conversion apart, and a scan from reading to reading."""
    newest_first = np.array(CONVERSION_ORDERS["lo_shu"])[::-1]
    np.testing.assert_array_equal(STEADY_AGES_S[0].argsort(), newest_first)
    steps_s = np.diff(STEADY_AGES_S[:, newest_first].ravel())
    np.testing.assert_allclose(steps_s, steps_s[0])
    assert 2.5e-3 < steps_s[0] < 3e-3
    assert STEADY_AGES_S.min() > 0.0
