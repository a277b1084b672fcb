"""Slip: told at the cone that earlier slips taught, by no slope, and by no push that ends."""

import math

import numpy as np
import pytest

from footsense.estimation.gait import NO_GROUND, FrictionEstimator, SlipDetector
from footsense.frames import Slip

STEP_NS = 5_433_400
RISE = np.linspace(0.25, 1.0, 4)


class Foot:
    """A foot whose tangential over normal force is given."""

    def __init__(self) -> None:
        self.friction = FrictionEstimator()
        self.detector = SlipDetector(self.friction)
        self.now_ns = 0
        self.slips: list[tuple[Slip, int]] = []

    def stand(self, ratios: list[float]) -> int:
        """Return the number of slips that are said in a stance of these ratios of tangential to normal force."""
        self.detector.reset_stance()
        self.slips.clear()
        for ratio in ratios:
            self.look(1.0, ratio)
        return sum(state is Slip.SLIPPING for state, _ in self.slips)

    def look(self, pressing_n: float, use: float) -> None:
        """Look once, and keep the slip that begins or ends."""
        ground = NO_GROUND._replace(
            pressing_n=pressing_n, tangential_over_normal=use, tangential_over_normal_sigma=0.015
        )
        slip = self.detector.observe(ground, self.now_ns)
        if slip is not None:
            self.slips.append((self.detector.state, slip.t_ns))
        self.now_ns += STEP_NS

    def kink(self, level: float) -> int:
        """Return the number of slips that are said while the ratio rises to a level and stays."""
        return self.stand([0.05] * 10 + (level * RISE).tolist() + [level] * 20)


def test_slips_teach_the_cone_and_are_said_once_from_then_on() -> None:
    """After four kinks at one ratio."""
    foot = Foot()
    assert [foot.kink(level) for level in (0.40, 0.41, 0.395)] == [0] * 3
    assert math.isnan(foot.friction.coefficient)
    assert foot.kink(0.4) == 1
    assert foot.friction.coefficient == pytest.approx(0.4, abs=0.01)
    states = []
    for uses in ([0.2] * 10 + [0.4] * 20, [0.2] * 30):
        foot.stand(uses)
        states.append(foot.detector.state)
    assert states == [Slip.SLIPPING, Slip.NONE]


def test_a_slide_that_is_unclear_at_first_teaches_as_well() -> None:
    """While the ratio jumps, its sigma is large for a scan."""
    foot = Foot()
    for _ in range(4):
        foot.stand([0.05] * 10)
        for _ in range(5):
            foot.look(1.0, math.nan)
        for _ in range(10):
            foot.look(1.0, 0.4)
    assert foot.friction.coefficient == pytest.approx(0.4)


def test_pushes_that_end_anywhere_teach_nothing() -> None:
    """Ratios that differ, and that higher ones exceed."""
    foot = Foot()
    for level in (0.1, 0.2, 0.3, 0.4, 0.5, 0.15, 0.25, 0.35):
        assert foot.kink(level) == 0
    assert math.isnan(foot.friction.coefficient)


def test_a_ratio_that_is_exceeded_is_not_the_cone() -> None:
    """Kinks at 0.2 seem to be the cone, until feet stick at 0.4."""
    foot = Foot()
    for _ in range(4):
        foot.kink(0.2)
    assert foot.friction.coefficient == pytest.approx(0.2)
    foot.kink(0.4)
    assert math.isnan(foot.friction.coefficient)


def test_a_slope_is_no_slip() -> None:
    """The ratio of a slope is there from the touchdown on, in every stance."""
    foot = Foot()
    assert sum(foot.stand([0.36] * 60) for _ in range(20)) == 0
    assert math.isnan(foot.friction.coefficient)


def test_a_slip_that_ends_is_said_with_the_times_of_both() -> None:
    """The first conversion at the cone and the first away from it, less the lag of the readings."""
    foot = Foot()
    for _ in range(4):
        foot.kink(0.4)
    start_ns = foot.now_ns
    foot.stand([0.2] * 10 + [0.4] * 20 + [0.2] * 20)
    (begins, begun_ns), (ends, ended_ns) = foot.slips
    assert (begins, ends) == (Slip.SLIPPING, Slip.NONE)
    assert begun_ns == pytest.approx(start_ns + 10 * STEP_NS, abs=10_000_000)
    assert ended_ns - begun_ns == 20 * STEP_NS
    assert foot.detector.state is Slip.NONE


@pytest.mark.parametrize(("pressing_n", "use"), [(math.nan, math.nan), (1.0, math.nan), (0.1, 0.4)])
def test_nothing_is_said_of_a_light_foot(pressing_n: float, use: float) -> None:
    """Below the load that tells friction, and without a ratio; a slip until then has ended."""
    foot = Foot()
    for _ in range(4):
        foot.kink(0.4)
    foot.stand([0.2] * 10 + [0.4] * 20)
    foot.look(pressing_n, use)
    foot.look(pressing_n, use)
    assert [state for state, _ in foot.slips] == [Slip.SLIPPING, Slip.UNKNOWN]
    assert foot.detector.state is Slip.UNKNOWN
