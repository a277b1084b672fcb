"""One leg's contact: what a glitch, a silence or a drift may not do, and which commands it forbids."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.estimation.drift import DRIFT_TIME_CONSTANT_S
from footsense.estimation.walking.contact import ContactDetector
from footsense.frames import CommandKind

MS = 1_000_000
SCAN_S = 0.025


class Leg:
    """A leg whose load is given, nine times a scan."""

    def __init__(self, scan_s: float = SCAN_S) -> None:
        self.contact = ContactDetector(0.03, 0.5e-3, scan_s)
        self.step_ns = round(1e9 * scan_s / 9)
        self.t_ns = 1_000 * MS
        self.contact.reset(self.t_ns)

    def carry(
        self,
        load_n: float,
        duration_s: float,
        predicted_n: float = math.nan,
        sigma_n: float = math.nan,
        acceleration_m_per_s2: float = math.nan,
    ) -> bool:
        """Carry a load for a time; return whether the foot is in contact then."""
        for _ in range(max(round(1e9 * duration_s / self.step_ns), 1)):
            self.t_ns += self.step_ns
            self.contact.observe(
                load_n, 0.002, self.t_ns, self.t_ns, predicted_n, sigma_n, acceleration_m_per_s2
            )
        return self.contact.in_contact

    def changes_after_s(self, load_n: float, limit_s: float = 1.0, **prediction: float) -> float | None:
        """Carry a load until contact changes; return the time until then [s], None if it does not within the limit."""
        before, begun_ns = self.contact.in_contact, self.t_ns
        while self.t_ns - begun_ns < 1e9 * limit_s:
            if self.carry(load_n, 0.0, **prediction) is not before:
                return 1e-9 * (self.t_ns - begun_ns)
        return None

    def step(self, n: int = 1, stance_s: float = 0.4, swing_s: float = 0.3, swing_n: float = 0.0) -> "Leg":
        """Carry a newton and be lifted, again and again."""
        for _ in range(n):
            self.carry(1.0, stance_s)
            self.carry(swing_n, swing_s)
        return self


@pytest.mark.parametrize(("load_n", "within_s"), [(0.1, 0.06), (0.3, 0.02), (1.0, 0.01)])
@pytest.mark.parametrize("scan_s", [0.007, 0.025, 0.045])
def test_a_touch_is_told_the_sooner_the_more_it_carries(
    load_n: float, within_s: float, scan_s: float
) -> None:
    """And dated within its sigma, at every rate."""
    leg = Leg(scan_s)
    leg.carry(0.0, 1.0)
    begun_ns = leg.t_ns
    told_s = leg.changes_after_s(load_n)
    assert told_s is not None
    assert told_s < within_s + scan_s
    t_ns, sigma_s = leg.contact.changed
    assert abs(t_ns - begun_ns) < 3e9 * sigma_s
    assert sigma_s < 0.02


@pytest.mark.parametrize(("between_s", "is_told"), [(0.06, True), (0.5, False)])
def test_the_time_of_a_foot_that_brushes_the_ground_before_it_stands_is_as_uncertain(
    between_s: float, *, is_told: bool
) -> None:
    """Too light a touch is no contact, but may have been its begin, unless that was long ago."""
    leg = Leg(0.007).step(5)
    brushed_ns = leg.t_ns
    assert not leg.carry(0.08, 0.004)
    assert not leg.carry(0.0, between_s)
    begun_ns = leg.t_ns
    assert leg.changes_after_s(1.0) is not None
    t_ns, sigma_s = leg.contact.changed
    assert abs(t_ns - begun_ns) < 0.01e9
    assert (t_ns - brushed_ns < 3e9 * sigma_s) is is_told
    assert (sigma_s < 0.01) is not is_told


def test_contact_has_hysteresis_and_swing_is_confirmed_later() -> None:
    """Far less than what begins it does not end it; a lifted foot is in swing for certain a fifth of a second later."""
    leg = Leg()
    leg.carry(0.0, 1.0)
    assert not leg.carry(0.01, 1.0)
    assert leg.carry(0.3, 0.5)
    assert leg.carry(0.15, 10.0)
    ended_ns = leg.t_ns
    assert leg.changes_after_s(0.0) is not None
    t_ns, sigma_s = leg.contact.changed
    assert abs(t_ns - ended_ns) < 3e9 * sigma_s
    assert not leg.contact.in_swing
    leg.carry(0.0, 0.18)
    assert not leg.contact.in_swing
    leg.carry(0.0, 0.1)
    assert leg.contact.in_swing


def test_a_light_stance_is_contact_for_ever_and_what_is_left_of_a_heavy_one_is_not() -> None:
    """A foot that stands with little stays in contact; small and steady after much more, the readings have shifted."""
    standing, shifted = Leg(), Leg()
    standing.carry(0.0, 1.0)
    assert standing.carry(0.12, 0.3)
    assert standing.changes_after_s(0.12, 60.0) is None
    shifted.step(5)
    shifted.carry(1.0, 0.4)
    assert not shifted.carry(0.05, 0.5)


def test_creep_follows_the_load_of_the_last_minutes() -> None:
    """A twentieth of a mean over three minutes."""
    leg = Leg()
    leg.carry(1.0, DRIFT_TIME_CONSTANT_S)
    assert leg.contact.drift_n == pytest.approx(0.002 + 0.05 * (1.0 - math.exp(-1.0)), rel=1e-3)
    leg.carry(-0.5, DRIFT_TIME_CONSTANT_S)
    assert leg.contact.drift_n == pytest.approx(
        0.002 + 0.05 * math.exp(-1.0) * (1.0 - math.exp(-1.0)), rel=1e-2
    )


@pytest.mark.parametrize("stance_before", [False, True])
def test_a_glitch_downwards_makes_no_contact(*, stance_before: bool) -> None:
    """Nor does a lift-off that swings below nothing; what a second below has done, the next step heals."""
    leg = Leg()
    leg.carry(0.0, 0.5)
    if stance_before:
        leg.carry(1.0, 0.5)
        leg.changes_after_s(0.0)
    leg.carry(-0.3, 0.01)
    assert leg.changes_after_s(0.0) is None
    leg.carry(-0.3, 1.0)
    leg.carry(1.0, 0.5)
    assert not leg.carry(0.0, 0.5)


def test_a_touch_is_predicted_before_the_mean_of_a_scan_shows_it() -> None:
    """Two conversions that predict a load make a contact; where the scan does not follow, it ends."""
    leg = Leg().step(3)
    soon_s = leg.changes_after_s(0.0, predicted_n=0.5, sigma_n=0.05)
    assert soon_s is not None
    assert soon_s < 0.012
    assert leg.changes_after_s(0.0, predicted_n=0.0, sigma_n=0.02) is not None
    assert leg.changes_after_s(0.0) is None


def test_a_load_that_sigma_does_not_allow_is_no_contact() -> None:
    """A line that breaks in swing: half a newton, measured and predicted, with a sigma of twice as much."""
    leg = Leg().step(3)
    assert leg.changes_after_s(0.5, 0.5, predicted_n=0.5, sigma_n=1.0) is None
    leg.carry(0.5, 0.5)
    assert leg.changes_after_s(0.5, 0.5, predicted_n=0.5, sigma_n=1.0) is None, "nor does a contact end by it"


def test_a_prediction_that_rings_after_lift_off_predicts_nothing() -> None:
    """For a tenth of a second; a touch that is measured counts all the same."""
    leg = Leg().step(3)
    leg.carry(1.0, 0.4)
    leg.changes_after_s(0.0)
    assert leg.changes_after_s(0.0, 0.1, predicted_n=0.5, sigma_n=0.05) is None
    assert leg.changes_after_s(0.0, 0.1, predicted_n=0.5, sigma_n=0.05) is not None
    leg.step(1)
    leg.carry(1.0, 0.4)
    leg.changes_after_s(0.0)
    assert leg.changes_after_s(0.5, 0.1) is not None


@pytest.mark.parametrize("hertz", [3.0, 8.0, 20.0])
def test_the_pull_of_a_foot_of_its_own_mass_is_learnt(hertz: float) -> None:
    """A tenth of what the foot carries: no contact but in the first swings, and a touch all the same."""
    shaking = Leg().step(1)
    touches = []
    for swing in range(12):
        shaking.carry(1.0, 0.4)
        shaking.changes_after_s(0.0)
        for n in range(100):
            shaking.carry(0.1 * math.sin(2.0 * math.pi * hertz * n * 1e-9 * shaking.step_ns), 0.0)
            if shaking.contact.in_contact:
                touches.append(swing)
        shaking.carry(0.0, 0.02)
    assert not [swing for swing in touches if swing > 3]
    assert shaking.changes_after_s(0.1, 0.2) is None
    assert shaking.changes_after_s(0.5, 0.05) is not None


def walk_with_pulls(told: Callable[[int], float]) -> tuple[int, float]:
    """Walk on feet of 10 g that are pulled in swing; return how often one touched in the air, and a delay [s].

    Args:
        told: What is told of the acceleration as of each step of a swing [m/s2].
    """
    leg, in_air = Leg(0.007), 0
    for swing in range(12):
        leg.carry(1.0, 0.4, acceleration_m_per_s2=told(0))
        leg.changes_after_s(0.0, acceleration_m_per_s2=told(0))
        for n in range(300):
            leg.carry(0.01 * _pull(n), 0.0, acceleration_m_per_s2=told(n))
            in_air += swing > 2 and leg.contact.in_contact
    leg.carry(1.0, 0.4, acceleration_m_per_s2=told(0))
    leg.changes_after_s(0.0, acceleration_m_per_s2=told(0))
    leg.carry(0.0, 0.3, acceleration_m_per_s2=told(299))
    return in_air, leg.changes_after_s(0.2, 0.5, acceleration_m_per_s2=told(299)) or math.inf


def _pull(n: int) -> float:
    return 20.0 * math.sin(0.05 * n) * math.exp(-(((n - 150) / 50.0) ** 2))


def test_a_known_acceleration_explains_the_pull_of_the_foot() -> None:
    """A light touch is told that could be pull without."""
    in_air, told_s = walk_with_pulls(lambda _n: math.nan)
    assert in_air == 0
    assert told_s > 0.05
    in_air, told_s = walk_with_pulls(lambda n: abs(_pull(n)))
    assert in_air == 0
    assert told_s < 0.02


@pytest.mark.parametrize(
    "told",
    [
        lambda n: 0.8 * abs(_pull(n)),
        lambda n: abs(_pull(n - 13)),
        lambda _n: 15.0,
        lambda n: 5.0 * abs(_pull(n)),
    ],
    ids=["scaled by 0.8", "10 ms late", "frozen", "five times too large"],
)
def test_a_wrong_acceleration_does_no_harm(told: Callable[[int], float]) -> None:
    in_air_without, told_without_s = walk_with_pulls(lambda _n: math.nan)
    in_air, told_s = walk_with_pulls(told)
    assert in_air <= 1.1 * in_air_without
    assert told_s <= 1.1 * told_without_s


@pytest.mark.parametrize("acceleration_m_per_s2", [0.0, 15.0])
def test_an_acceleration_first_told_in_the_middle_of_a_walk_makes_no_touch_late(
    acceleration_m_per_s2: float,
) -> None:
    """What the swings before have shown of the pull counts on."""

    def told_after_s(acceleration_m_per_s2: float) -> float:
        leg = Leg(0.007).step(8)
        leg.carry(1.0, 0.4, acceleration_m_per_s2=acceleration_m_per_s2)
        leg.carry(0.0, 0.3, acceleration_m_per_s2=acceleration_m_per_s2)
        return leg.changes_after_s(0.2, acceleration_m_per_s2=acceleration_m_per_s2) or math.inf

    assert told_after_s(acceleration_m_per_s2) <= 1.1 * told_after_s(math.nan)


def test_an_acceleration_that_is_told_no_longer_explains_nothing() -> None:
    """A tenth of a second later the same light touch is told as late as if nothing had ever been told."""
    leg = Leg(0.007)
    for _ in range(12):
        leg.carry(1.0, 0.4, acceleration_m_per_s2=0.0)
        leg.changes_after_s(0.0, acceleration_m_per_s2=0.0)
        for n in range(300):
            leg.carry(0.01 * _pull(n), 0.0, acceleration_m_per_s2=abs(_pull(n)))
    leg.carry(0.0, 0.1)
    _, untold_s = walk_with_pulls(lambda _n: math.nan)
    assert (leg.changes_after_s(0.2, 0.5) or math.inf) >= 0.5 * untold_s


@pytest.mark.parametrize(("n_per_s", "late_s"), [(0.1, 0.7), (0.3, 0.3), (1.0, 0.1), (3.0, 0.03)])
def test_a_load_that_comes_slowly_is_a_touch(n_per_s: float, late_s: float) -> None:
    """Of a foot that carries a newton; dated so much after it exceeds a hundredth of that at most, and not before."""
    leg = Leg().step(3)
    begun_ns, load_n = leg.t_ns, 0.0
    while not leg.carry(load_n, 0.0):
        load_n += n_per_s * 1e-9 * leg.step_ns
        assert load_n < 0.6
    dated_s = 1e-9 * (leg.contact.changed.t_ns - begun_ns) - 0.01 / n_per_s
    assert -0.01 < dated_s < late_s


def test_a_load_that_comes_as_slowly_as_drift_is_none() -> None:
    """Half of the fastest rise that is followed, for ten minutes."""
    leg = Leg(0.25)
    for n in range(round(600e9 / leg.step_ns)):
        assert not leg.carry(0.25e-3 * n * 1e-9 * leg.step_ns, 0.0)


def test_a_bounce_is_no_lift_off() -> None:
    """The load after an impact may be gone for 10 ms; after a stance of 0.4 s a lift-off is told within 40 ms."""
    leg = Leg().step(3)
    assert leg.carry(1.0, 0.03)
    assert leg.changes_after_s(0.0, 0.01) is None
    assert leg.carry(0.3, 0.4)
    told_s = leg.changes_after_s(0.0)
    assert told_s is not None
    assert told_s < 0.04


def test_silence_is_not_contact() -> None:
    """Believed for a quarter of a second without a reading, unknown then; found again by the next readings."""
    leg = Leg()
    leg.carry(0.5, 0.1)
    assert math.isfinite(leg.contact.probability)
    assert leg.carry(math.nan, 0.24)
    assert math.isnan(leg.contact.probability)
    assert not leg.carry(math.nan, 0.02)
    assert not leg.contact.in_swing
    assert not leg.contact.explained_by_drift
    assert leg.carry(0.5, 0.02)


@given(st.lists(st.tuples(st.floats(-2, 2) | st.just(math.nan), st.integers(-50, 500)), max_size=60))
def test_whatever_was_read_rest_is_swing_and_a_newton_on_top_is_contact(
    readings: list[tuple[float, int]],
) -> None:
    """Probabilities stay probabilities, and a touch is dated before it is told."""
    leg = Leg()
    for load_n, passed_ms in readings:
        leg.t_ns += passed_ms * MS
        leg.carry(load_n, 0.0)
        assert not (leg.contact.in_contact and leg.contact.in_swing)
        assert math.isnan(load_n) or 0.0 <= leg.contact.probability <= 1.0
    leg.carry(1.0, 1.0)
    leg.carry(0.0, 1.0)
    assert not leg.contact.in_contact
    assert leg.contact.in_swing
    assert leg.carry(1.0, 0.03)
    assert leg.contact.changed.t_ns <= leg.t_ns


@pytest.mark.parametrize(
    ("kind", "in_contact", "load_n", "drift_n", "says"),
    [
        (CommandKind.START, True, 1.0, 0.0, None),
        (CommandKind.STOP, False, 0.0, 0.0, None),
        (CommandKind.STOP, False, math.nan, 0.0, None),
        (CommandKind.STOP, True, 0.41, 0.5, "carries 0.41 N"),
        (CommandKind.STOP, True, math.nan, 0.0, "not known now"),
        (CommandKind.TARE, False, 0.02, 0.0, None),
        (CommandKind.TARE, False, math.nan, 0.0, None),
        (CommandKind.TARE, True, 0.41, 0.05, "carries 0.41 N, and drift explains at most 0.05 N"),
        (CommandKind.TARE, True, 0.04, 0.05, None),
        (CommandKind.TARE, True, math.nan, 0.05, "not known now"),
    ],
)
def test_commands_only_where_they_are_safe(
    kind: CommandKind, *, in_contact: bool, load_n: float, drift_n: float, says: str | None
) -> None:
    """On the ground no STOP and no TARE, unless drift explains the whole load; START and unknown contact always."""
    contact = ContactDetector(0.03, 0.5e-3, 0.025)
    contact.in_contact, contact.drift_n = in_contact, drift_n
    contact.load_n = contact.carried_n = load_n
    reason = contact.refusal(kind)
    assert reason is None if says is None else reason is not None and says in reason
