"""Slip: told where the friction ratio comes to the coefficient that the configuration knows, and nowhere else."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.estimation.walking.ground import NO_GROUND, SlipDetector
from footsense.frames import Slip

STEP_NS = 5_433_400


class Foot:
    """A foot whose tangential over normal force is given."""

    def __init__(self, friction: float = 0.4) -> None:
        self.detector = SlipDetector(friction)
        self.now_ns = 0
        self.slips: list[tuple[Slip, int]] = []

    def stand(self, ratios: list[float], sigma: float = 0.015) -> None:
        """Look once at each ratio, and keep the slips that begin or end."""
        for ratio in ratios:
            ground = NO_GROUND._replace(
                pressing_n=1.0, tangential_over_normal=ratio, tangential_over_normal_sigma=sigma
            )
            t_ns = self.detector.observe(ground, self.now_ns)
            if t_ns is not None:
                self.slips.append((self.detector.state, t_ns))
            self.now_ns += STEP_NS


def test_a_slip_is_told_once_with_the_times_of_begin_and_end() -> None:
    """The first check at the cone and the first away from it, less the lag of the readings."""
    foot = Foot()
    foot.stand([0.2] * 10 + [0.4] * 20 + [0.2] * 20)
    (begins, begun_ns), (ends, ended_ns) = foot.slips
    assert (begins, ends) == (Slip.SLIPPING, Slip.NONE)
    assert begun_ns == pytest.approx(10 * STEP_NS, abs=10_000_000)
    assert ended_ns - begun_ns == 20 * STEP_NS
    assert foot.detector.state is Slip.NONE


@given(st.lists(st.floats(0.0, 2.0), max_size=60))
def test_without_a_coefficient_nothing_is_told(ratios: list[float]) -> None:
    """A gait repeats its ratios: no force tells the ground's coefficient."""
    foot = Foot(math.nan)
    foot.stand(ratios)
    assert not foot.slips
    assert foot.detector.state is Slip.UNKNOWN


@given(st.lists(st.floats(0.0, 0.35), max_size=60))
def test_a_foot_within_the_cone_never_slips(ratios: list[float]) -> None:
    """Whatever its ratio does."""
    foot = Foot()
    foot.stand(ratios)
    assert not foot.slips


def test_a_ratio_that_is_not_known_well_tells_nothing() -> None:
    """As just after a touch; a slip that was told goes on."""
    foot = Foot()
    foot.stand([0.4] * 10, sigma=0.15)
    assert foot.detector.state is Slip.UNKNOWN
    foot.stand([0.4] * 3)
    foot.stand([0.1] * 10, sigma=0.15)
    assert [state for state, _ in foot.slips] == [Slip.SLIPPING]


def test_a_slip_ends_with_the_load() -> None:
    """Without a ratio there is no telling."""
    foot = Foot()
    foot.stand([0.4] * 10 + [math.nan] * 2)
    assert [state for state, _ in foot.slips] == [Slip.SLIPPING, Slip.UNKNOWN]
