"""Drift makes no contact, and drift tracking absorbs no load."""

import numpy as np
import pytest

from footsense.frames import BaselineStatus, Result
from tests.support.standing import MN_PER_FF, SCAN_S, TOUCH_N, Creep, Standing, stance_n


def test_seven_kelvin_in_two_hundred_seconds_of_walking() -> None:
    """No contact in swing and no stance without, in cold and heat; what is left of the drift is below 1 mN."""
    drift_ff = np.array([-10.0, 0.0, 10.0])[:, None] * np.linspace(0.8, 1.2, 9)
    feet = Standing(3).tared()
    worst_ff, t_s, lifted_s = 0.0, 0.0, 0.0
    while t_s < 200.0:
        # Nothing is learnt in the middle of a stance: fewer readings there keep the test short.
        passed_s = 0.2 if stance_n(t_s) > 0.999 and stance_n(t_s + 0.2) > 0.999 else SCAN_S
        t_s += passed_s
        now_ff = drift_ff * t_s / 200.0
        feet.feed(stance_n(t_s), now_ff, passed_s)
        if stance_n(t_s) > 0.4:
            assert feet.in_contact.all(), t_s
            lifted_s = t_s
        elif stance_n(t_s) == 0.0 and t_s - lifted_s > 0.1:
            assert not feet.in_contact.any(), t_s
        worst_ff = max(worst_ff, float(np.abs((feet.baseline_ff - now_ff).mean(axis=1)).max()))
    assert worst_ff * MN_PER_FF < 1.0
    assert np.abs(feet.baseline_ff - drift_ff).max() < 1.5
    np.testing.assert_allclose(feet.tracker.unloaded.drift.mean_pf * 1e3, [-10.0, 0.0, 10.0], atol=1.0)


def test_drift_makes_no_contact_even_if_the_baseline_does_not_follow() -> None:
    """Ten minutes of the fastest drift are twice the threshold; a touch is found above them all the same."""
    feet = Standing(2, track=False).tared()
    for step in range(2400):
        feet.feed(0.0, 0.15 * 0.25 * step * np.array([1.0, -1.0]), 0.25)
        assert not feet.in_contact.any()
    assert (feet.tracker.unloaded.drift.status == BaselineStatus.HELD).all()
    assert np.abs(feet.baseline_ff).max() < 1.0
    feet.feed(1.3 * TOUCH_N, 90.0 * np.array([1.0, -1.0]))
    assert feet.in_contact.all()


def test_a_stance_of_half_an_hour_is_not_eaten() -> None:
    """Frozen to the bit, in contact to the end, however light; then the creep's recovery moves it by 2.5 fF in 10 s.

    The feet also cool by 20 K or heat up by it meanwhile, so that none returns to its baseline.
    """
    stands_n = np.array([1.0, 1.0, 1.0, 0.3, 0.1, 0.05])
    drift_ff = np.array([0.0, 30.0, -30.0, 0.0, 0.0, 0.0])
    feet, creep = Standing(6).tared(), Creep()
    before_pf = grounded_pf = feet.tracker.unloaded.baseline_pf
    steps = 3600
    for step in range(steps):
        force_n = stands_n * min(step / 4, 1.0)
        feet.feed(force_n + creep.after(force_n, 0.5), drift_ff * step / steps, 0.5)
        assert feet.in_contact.all() or step < 4
        if step > 4:
            np.testing.assert_array_equal(feet.tracker.unloaded.baseline_pf, grounded_pf)
            assert (feet.tracker.unloaded.drift.status == BaselineStatus.HELD).all()
        grounded_pf = feet.tracker.unloaded.baseline_pf
    assert np.abs(grounded_pf - before_pf).max() * 1e3 < 2.0
    # Two standard deviations of ten minutes are 20 K: 26 fF after thirty, and 2.7 N per gap along the leg.
    np.testing.assert_allclose(feet.tracker.unloaded.sigma_n[:, 2], 0.0171, rtol=0.02)

    moved_ff = {}
    for step in range(round(10.0 / SCAN_S)):
        force_n = stands_n * max(1.0 - step / 4, 0.0)
        feet.feed(force_n + creep.after(force_n, SCAN_S), drift_ff)
        if step == 8:
            assert not feet.in_contact.any()
        moved_ff[step] = float(np.abs(feet.tracker.unloaded.baseline_pf - grounded_pf).max()) * 1e3
    assert moved_ff[round(0.2 / SCAN_S)] == 0.0
    assert moved_ff[round(1.0 / SCAN_S)] < 1.3
    assert moved_ff[round(9.9 / SCAN_S)] < 2.7


@pytest.mark.parametrize(
    ("n_per_s", "found_n", "swallowed_mn"),
    [(1 / 3, 0.05, 1.0), (1 / 60, 0.035, 1.0), (1 / 600, 0.04, 2.0)],
)
def test_a_load_that_comes_slowly_in_the_air_is_contact(
    n_per_s: float, found_n: float, swallowed_mn: float
) -> None:
    """It is detected slightly above the threshold, and the baseline has not followed it."""
    feet = Standing(1).tared()
    force_n = 0.0
    while not feet.in_contact[0]:
        force_n += n_per_s * SCAN_S
        feet.feed(force_n)
        assert force_n < found_n
    for _ in range(1000):
        feet.feed(force_n)
    assert feet.baseline_ff.mean() * MN_PER_FF < swallowed_mn


def test_a_load_as_slow_as_drift_is_followed_up_to_what_drift_explains() -> None:
    """1 N in an hour cannot be told from drift, at 0.3 mN/s: half a threshold is absorbed, then: DRIFT_TOO_FAST."""
    feet = Standing(1).tared()
    for step in range(4000):
        feet.feed(step * 0.1 / 3600, passed_s=0.1)
    assert feet.tracker.unloaded.drift.status[0] == BaselineStatus.DRIFT_TOO_FAST
    assert not feet.in_contact[0]
    assert feet.baseline_ff.mean() * MN_PER_FF < 1e3 * TOUCH_N / 2


def test_conversion_by_conversion_is_like_scan_by_scan() -> None:
    """Times are in seconds: the same contacts within a scan, the same baseline within noise, at nine times the rate."""
    touchdowns_s: list[list[float]] = []
    baselines_ff = []
    for element_by_element in (False, True):
        feet = Standing(1, element_by_element=element_by_element).tared()
        assert [outcome.result for outcome in feet.outcomes] == [Result.DONE]
        start_ns, was, found_s = feet.t_ns, False, []
        while (t_s := (feet.t_ns - start_ns) * 1e-9) < 12.0:
            feet.feed(stance_n(t_s + 0.6), 0.1 * t_s)
            if feet.in_contact[0] and not was:
                found_s.append(t_s)
            was = bool(feet.in_contact[0])
        touchdowns_s.append(found_s)
        baselines_ff.append(feet.baseline_ff.mean())
    np.testing.assert_allclose(touchdowns_s[0], touchdowns_s[1], atol=0.03)
    assert len(touchdowns_s[0]) == 11
    np.testing.assert_allclose(baselines_ff, 1.2, atol=0.5)


def test_a_baseline_names_why_it_does_not_follow() -> None:
    """A foot whose elements shake, one whose readings fall faster than they can, one on the ground, and a free one."""
    feet = Standing(4).tared()
    drift_ff = np.zeros((4, 9))
    for step in range(200):
        drift_ff[0] = 12.0 * (-1.0) ** (step + np.arange(9))
        drift_ff[1] = -0.5 * step
        feet.feed(np.array([0.0, 0.0, 0.5, 0.0]), drift_ff)
    assert feet.tracker.unloaded.drift.status.tolist() == [
        BaselineStatus.NOT_QUIET,
        BaselineStatus.DRIFT_TOO_FAST,
        BaselineStatus.HELD,
        BaselineStatus.TRACKING,
    ]
