"""Whether a foot holds: by its ratio of forces against the ground's friction, each as well as it is known; slips."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.estimation.walking.holds import GroundFriction, Holding, ratio_sigma

STEP_NS = 13_400_000
RATIO = st.floats(0.0, 2.0) | st.just(math.nan)
SIGMA = st.floats(1e-3, 0.2)


class Foot:
    """A foot on the ground whose tangential over normal force is given."""

    def __init__(self, friction: float = 0.4) -> None:
        self.friction = GroundFriction(friction)
        self.holding = Holding(self.friction)
        self.now_ns = 0
        self.slips: list[tuple[bool, int]] = []

    def stand(self, ratios: list[float], sigma: float = 0.015) -> float:
        """Look once at each ratio, keep the slips that begin or end; return the probability that the foot holds."""
        for ratio in ratios:
            self.now_ns += STEP_NS
            self.friction.pass_time(1e-9 * STEP_NS)
            if self.holding.observe(ratio, sigma, 1e-9 * STEP_NS, self.now_ns):
                self.slips.append((self.holding.slips, self.holding.since_ns))
        return self.holding.probability


def test_a_foot_far_from_the_cone_holds_and_one_at_it_does_not() -> None:
    """With a sigma that tells them apart."""
    assert Foot().stand([0.2] * 20) > 0.98
    assert Foot().stand([0.4] * 20) < 0.05


def test_a_ratio_that_is_not_known_well_says_little() -> None:
    """The wider sigma, the less is said; a large ratio is expected to be underestimated."""
    for ratio in (0.2, 0.4):
        sharp, wide = Foot().stand([ratio] * 20), Foot().stand([ratio] * 20, sigma=0.19)
        unknown = Foot().stand([math.nan] * 20)
        assert abs(wide - unknown) < min(0.06, abs(sharp - unknown))
    assert Foot(0.8).stand([0.72] * 20, sigma=0.05) < 0.1


def test_a_slip_is_told_once_with_the_times_of_begin_and_end() -> None:
    """Since a slide is more likely than not, and since it is not any more."""
    foot = Foot()
    foot.stand([0.2] * 10 + [0.4] * 20 + [0.2] * 20)
    (begins, begun_ns), (ends, ended_ns) = foot.slips
    assert begins
    assert not ends
    assert begun_ns == pytest.approx(10 * STEP_NS, abs=8 * STEP_NS)
    assert ended_ns == pytest.approx(30 * STEP_NS, abs=8 * STEP_NS)


def test_nothing_is_told_of_a_ratio_that_is_not_known() -> None:
    """Not even on ice, where a foot that touches will slide."""
    foot = Foot(0.2)
    assert foot.stand([math.nan] * 20) < 0.2
    assert not foot.slips
    assert not foot.holding.is_known


def test_a_friction_that_is_a_fifth_off_follows_the_feet() -> None:
    """Down from one that is too high, up from one that is too low: a foot that holds within it is seen to."""
    for wrong in (0.32, 0.48):
        foot = Foot(wrong)
        foot.stand([0.4] * 300)
        assert foot.friction.mean == pytest.approx(0.4, abs=0.03)
        assert foot.stand([0.4] * 20) < 0.2
        foot.holding.reset_stance()
        assert foot.stand([0.25] * 20) > 0.9
        foot.stand([math.nan] * 3000)
        assert foot.friction.mean == pytest.approx(wrong, abs=0.02)


def test_without_a_coefficient_a_small_ratio_does_not_make_the_ground_ice() -> None:
    """A gait that asks little repeats its largest ratio, as a slide does; a large ratio shows what the ground gives."""
    foot = Foot(math.nan)
    assert foot.stand([0.1, 0.15, 0.2, 0.15] * 500) > 0.9
    assert not foot.slips
    foot.stand([0.9] * 20)
    assert foot.friction.mean > 0.85


@given(st.floats(0.1, 2.0) | st.just(math.nan), st.lists(st.tuples(RATIO, SIGMA), max_size=60))
def test_whatever_the_ratios_are_it_is_a_probability(
    friction: float, ratios: list[tuple[float, float]]
) -> None:
    """And the ground's friction stays a positive number, whose sigma never exceeds what it began with."""
    foot = Foot(friction)
    for ratio, sigma in ratios:
        assert 0.0 <= foot.stand([ratio], sigma) <= 1.0
        assert foot.friction.mean > 0.0
        assert 0.0 < foot.friction.variance < math.inf
    assert [begins for begins, _ in foot.slips] == [n % 2 == 0 for n in range(len(foot.slips))]


@given(st.floats(0.3, 1.0), st.floats(0.0, 0.5), st.floats(5e-3, 0.03))
def test_a_foot_within_half_the_cone_never_slips(friction: float, share: float, sigma: float) -> None:
    foot = Foot(friction)
    foot.stand([share * friction] * 60, sigma)
    assert not foot.slips


@given(st.floats(0.0, 1.0), SIGMA)
def test_the_sigma_of_a_ratio_holds_what_it_may_be_short_by(ratio: float, sigma: float) -> None:
    assert sigma <= ratio_sigma(ratio, sigma) <= 3.2 * sigma
