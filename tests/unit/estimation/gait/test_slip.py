"""Slip: told at the cone that earlier slips taught, by no slope, and by no push that ends."""

import math

import numpy as np
import pytest

from footsense.estimation.gait.frame import Slip
from footsense.estimation.gait.ground import NO_GROUND
from footsense.estimation.gait.slip import Friction, SlipDetector

RISE = np.linspace(0.05, 1.0, 8)


class Foot:
    """A foot whose friction use is given."""

    def __init__(self) -> None:
        self.friction = Friction()
        self.detector = SlipDetector(self.friction)

    def stand(self, uses: list[float]) -> int:
        """Return the number of slips that are said in a stance of these friction uses."""
        self.detector.lift()
        ground = NO_GROUND._replace(pressing_n=1.0, friction_use_sigma=0.015)
        return sum(self.detector.observe(ground._replace(friction_use=use)) for use in uses)

    def kink(self, level: float) -> int:
        """Return the number of slips that are said while the ratio rises to a level and stays."""
        return self.stand([0.05] * 10 + (level * RISE).tolist() + [level] * 20)


def test_slips_teach_the_cone_and_are_said_once_from_then_on() -> None:
    """After five kinks at one ratio."""
    foot = Foot()
    assert [foot.kink(level) for level in (0.40, 0.41, 0.395, 0.405)] == [0] * 4
    assert math.isnan(foot.friction.coefficient)
    assert foot.kink(0.4) == 1
    assert foot.friction.coefficient == pytest.approx(0.4, abs=0.01)
    states = []
    for uses in ([0.2] * 10 + [0.4] * 20, [0.2] * 30):
        foot.stand(uses)
        states.append(foot.detector.state)
    assert states == [Slip.SLIPPING, Slip.NONE]


def test_pushes_that_end_anywhere_teach_nothing() -> None:
    """Ratios that differ, and that higher ones exceed."""
    foot = Foot()
    for level in (0.1, 0.2, 0.3, 0.4, 0.5, 0.15, 0.25, 0.35):
        assert foot.kink(level) == 0
    assert math.isnan(foot.friction.coefficient)


def test_a_ratio_that_is_exceeded_is_not_the_cone() -> None:
    """Kinks at 0.2 seem to be the cone, until feet stick at 0.4."""
    foot = Foot()
    for _ in range(5):
        foot.kink(0.2)
    assert foot.friction.coefficient == pytest.approx(0.2)
    foot.kink(0.4)
    assert math.isnan(foot.friction.coefficient)


def test_a_slope_is_no_slip() -> None:
    """The ratio of a slope is there from the touchdown on, in every stance."""
    foot = Foot()
    assert sum(foot.stand([0.36] * 60) for _ in range(20)) == 0
    assert math.isnan(foot.friction.coefficient)


def test_nothing_is_said_of_a_light_foot() -> None:
    """Below the load that tells friction, and without a ratio."""
    foot = Foot()
    assert not foot.detector.observe(NO_GROUND)
    assert foot.detector.state is Slip.UNKNOWN
    assert not foot.detector.observe(NO_GROUND._replace(pressing_n=1.0))
    assert foot.detector.state is Slip.UNKNOWN
