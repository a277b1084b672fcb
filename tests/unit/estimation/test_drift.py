"""One leg's baseline: its reach, its uncertainty, and its limits."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from footsense.estimation.drift import (
    MAX_ANCHOR_DISTANCE_PF,
    MAX_DRIFT_PF_PER_S,
    LegBaseline,
    UnloadedFeet,
    baseline_sigma_pf,
)
from footsense.estimation.noise import ReadingNoise
from footsense.estimation.settings import MountedFeet, TareLimits
from footsense.frames import BaselineStatus, Cause
from tests.support.feet import DESIGN
from tests.support.standing import SENSITIVITY

UNLOADED_PF = np.full(9, 5.4)
LIMITS = TareLimits(window_scans=4, noise_limit_ff=5.0, unloaded_limit_rel=0.03)
S = 1_000_000_000


class Swinging:
    """A foot in the air, read every 25 ms."""

    def __init__(self, tared_pf: np.ndarray = UNLOADED_PF) -> None:
        self.baseline = LegBaseline(UNLOADED_PF, LIMITS)
        self.t_ns = 10 * S
        self.baseline.set_tared(tared_pf, self.t_ns)

    def sigma_pf(self, t_ns: int) -> float:
        return float(baseline_sigma_pf(self.baseline.variance_pf2, self.baseline.updated_ns, t_ns))

    def read(self, offset_ff: float | np.ndarray, n: int = 1, passed_ns: int = S // 40) -> None:
        for _ in range(n):
            self.t_ns += passed_ns
            self.baseline.observe_swing(
                UNLOADED_PF + np.asarray(offset_ff) * 1e-3, np.full(9, self.t_ns), None
            )


@given(
    st.lists(
        st.tuples(st.floats(-200, 200), st.integers(1, 40), st.integers(1, 20 * S), st.booleans()),
        max_size=20,
    )
)
def test_no_reading_moves_it_faster_or_farther_than_it_may(
    history: list[tuple[float, int, int, bool]],
) -> None:
    """Two margins and the fastest drift bound every way; the tare's limit bounds the place."""
    foot = Swinging()
    start_ns = foot.t_ns
    for offset_ff, n, passed_ns, grounded in history:
        if grounded:
            foot.baseline.pause_tracking()
            foot.t_ns += passed_ns
        else:
            foot.read(offset_ff, n, passed_ns)
        moved_pf = np.abs(foot.baseline.baseline_pf - UNLOADED_PF).max()
        assert (
            moved_pf <= 2 * MAX_ANCHOR_DISTANCE_PF + MAX_DRIFT_PF_PER_S * (foot.t_ns - start_ns) / S + 1e-12
        )
        assert moved_pf <= 0.03 * 5.4 + 1e-12
        assert 0.0 < foot.sigma_pf(foot.t_ns) < 1.0


def test_the_newest_reading_is_never_used() -> None:
    """It may be the first of a touchdown: the baseline moves by the one before it."""
    moved_pf = []
    for newest_ff in (0.5, -3.0, 4.0):
        foot = Swinging()
        foot.read(0.5)
        np.testing.assert_array_equal(foot.baseline.baseline_pf, UNLOADED_PF)
        foot.read(newest_ff)
        moved_pf.append(foot.baseline.baseline_pf - UNLOADED_PF)
    assert (moved_pf[0] > 0.0).all()
    np.testing.assert_array_equal(moved_pf[1:], moved_pf[:1] * 2)


def test_a_lift_off_begins_with_two_new_readings() -> None:
    """The last reading before a stance confirms nothing after it."""
    foot = Swinging()
    foot.read(0.5, 3)
    foot.baseline.pause_tracking()
    held_pf = foot.baseline.baseline_pf
    foot.read(0.6)
    np.testing.assert_array_equal(foot.baseline.baseline_pf, held_pf)
    foot.read(0.6)
    assert (foot.baseline.baseline_pf > held_pf).all()


def test_a_shift_is_known_after_two_quiet_readings_of_a_swing() -> None:
    """A swing of a fast gait has no more; noise and the way back are a mean of many."""
    foot = Swinging()
    foot.read(-80.0, 2)
    np.testing.assert_allclose(foot.baseline.left_pf, -0.08)
    foot.read(-70.0, 2)
    assert -0.08 < foot.baseline.left_pf[0] < -0.07
    foot.read(0.0, 10)
    assert -0.07 < foot.baseline.left_pf[0] < -0.01


def test_a_frame_counts_only_if_every_element_was_read_anew() -> None:
    """Nine frames with one new element each are one reading."""
    foot = Swinging()
    stamps = np.full(9, foot.t_ns)
    moved = []
    for frame in range(27):
        stamps = stamps.copy()
        stamps[frame % 9] = foot.t_ns + (frame + 1) * 2_500_000
        moved.append(foot.baseline.observe_swing(UNLOADED_PF + 1e-3, stamps, None))
    assert sum(moved) == 2


def test_it_stops_where_a_tare_would_be_refused() -> None:
    """DRIFT_TOO_LARGE, element by element; the way back is open."""
    foot = Swinging(UNLOADED_PF * 1.0299)
    foot.read(5.4 * 0.05 * 1e3 * np.eye(9)[3] + 5.4 * 0.0299 * 1e3 * (1 - np.eye(9)[3]), 200)
    assert foot.baseline.status is BaselineStatus.DRIFT_TOO_LARGE
    assert foot.baseline.baseline_pf[3] <= 5.4 * 1.03
    foot.read(5.4 * 0.02 * 1e3, 60)
    assert foot.baseline.offset_pf[0] < -0.5e-3


def test_an_element_without_a_baseline_gets_one_from_two_quiet_readings() -> None:
    """And only near what the free foot reads; the offset counts from there."""
    tared_pf = UNLOADED_PF.copy()
    tared_pf[[2, 5]] = np.nan
    foot = Swinging(tared_pf)
    away_ff = np.zeros(9)
    away_ff[5] = 500.0
    foot.read(away_ff + 1.0, 3)
    assert np.isfinite(foot.baseline.baseline_pf[2])
    assert np.isnan(foot.baseline.baseline_pf[5])
    assert np.abs(foot.baseline.offset_pf).max() < 2e-3


def test_an_element_that_is_back_gets_no_baseline_from_a_reading_that_jumps() -> None:
    """Twice the noise that a tare allows, between two readings of the others that are quiet."""
    tared_pf = UNLOADED_PF.copy()
    tared_pf[2] = np.nan
    foot = Swinging(tared_pf)
    jump_ff = 2.0 * 5.0 * np.eye(9)[2]
    foot.read(0.0)
    foot.read(jump_ff)
    assert foot.baseline.status is BaselineStatus.TRACKING
    assert np.isnan(foot.baseline.baseline_pf[2])
    foot.read(jump_ff)
    assert np.isfinite(foot.baseline.baseline_pf[2])


def test_a_noisy_leg_is_noisy_until_it_is_well_below_the_limit() -> None:
    """Between the limit of a tare and three quarters of it, what was stays."""
    noise = ReadingNoise(1, np.eye(9))
    feet = UnloadedFeet(MountedFeet.of(DESIGN, [None]), DESIGN, LIMITS, SENSITIVITY, noise)
    noise.variance_rel = [1e-12]
    feet.update_sigma(S)
    rel_of_limit = 1e-6 * LIMITS.noise_limit_ff / feet.noise_ff
    causes = []
    for t, share in enumerate((0.9, 1.1, 0.9, 0.8, 0.7, 0.9)):
        noise.variance_rel = ((share * rel_of_limit) ** 2).tolist()
        feet.update_sigma((2 + t) * S)
        causes.append(int(feet.cause[0]))
    noisy, none = Cause.NOISY, Cause.NONE
    assert causes == [none, noisy, noisy, noisy, none, none]
