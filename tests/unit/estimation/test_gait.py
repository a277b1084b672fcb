"""Gait semantics: what is said of feet that touch, carry, lean and lift; no event twice, NaN where there is nothing."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from footsense.estimation.walking.contact import ContactDetector
from footsense.estimation.walking.gait import GaitTracker
from footsense.frames import GaitEvent, GaitEventKind, GaitFrame, Slip, Vector
from footsense.ports import LoadEstimate

LEGS = 6
STEP_NS = 2_716_700
SIGMA = 0.02


class Robot:
    """Feet whose normal forces are given; all contacts lean by one angle, with one friction ratio."""

    def __init__(self, friction: float = math.nan) -> None:
        self.tracker = GaitTracker(LEGS, friction, period_ns=0)
        self.contacts = [ContactDetector(0.03, 0.5e-3, 0.025) for _ in range(LEGS)]
        self.now_ns = 1_000_000_000
        for contact in self.contacts:
            contact.reset(self.now_ns)
        self.events: list[GaitEvent] = []
        self.lean_rad, self.ratio = 0.0, 0.0

    def step(self, load_n: Vector, n: int = 1, mean_n: Vector | None = None) -> GaitFrame:
        """Return the last frame of n conversions of normal forces [N], shape (legs,), NaN where not known.

        The mean of a scan is that of the forces unless it is given.
        """
        normal = np.array([math.sin(self.lean_rad), 0.0, math.cos(self.lean_rad)])
        across = np.array([math.cos(self.lean_rad), 0.0, -math.sin(self.lean_rad)])
        force_n = load_n[:, None] * (normal + self.ratio * across)
        point = normal[0] / (1.0 + normal[2])
        row = [point, 0.0, self.ratio * across[0], 0.0]
        for _ in range(n):
            self.now_ns += STEP_NS
            load = LoadEstimate(
                force_n, np.full((LEGS, 3), 1e-3), np.tile(row, (LEGS, 1)), np.full((LEGS, 4), SIGMA)
            )
            means_n = (force_n[:, 2] if mean_n is None else mean_n).tolist()
            for contact, leg_n, of_scan_n in zip(self.contacts, force_n[:, 2].tolist(), means_n, strict=True):
                contact.observe(of_scan_n, 0.001, self.now_ns, self.now_ns, leg_n)
            frame = self.tracker.observe(load, self.contacts, self.now_ns)
            assert frame is not None
            self.events += frame.events
            last = frame
        return last


def test_feet_in_the_air_say_so_and_nothing_else() -> None:
    """No contact, no normal, no friction, no share of a load that nobody carries."""
    robot = Robot()
    frame = robot.step(np.zeros(LEGS), 100)
    assert frame.all_in_air
    assert not frame.contact.any()
    assert not frame.contact_raw.any()
    assert not frame.events
    assert max(robot.tracker.contact_probability) < 0.01
    assert max(robot.tracker.holds) < 0.01
    assert (frame.touchdown_ns == 0).all()
    assert (frame.slip == Slip.UNKNOWN).all()
    for nothing in (frame.normal, frame.tangential_over_normal, frame.load_share, frame.touchdown_sigma_s):
        assert np.isnan(nothing).all()


def test_a_stance_is_told_with_its_ground() -> None:
    """Normal and force ratio of a foot that leans by 20 deg; shares of the load; one touchdown for each."""
    robot = Robot()
    robot.step(np.zeros(LEGS), 100)
    robot.lean_rad, robot.ratio = math.radians(20.0), 0.3
    frame = robot.step(np.array([1.0, 0.5, 0.5, 0.0, 0.0, 0.0]), 30)
    assert frame.contact.tolist() == [True] * 3 + [False] * 3
    assert not frame.all_in_air
    assert frame.load_share.tolist() == pytest.approx([0.5, 0.25, 0.25, 0.0, 0.0, 0.0])
    assert frame.normal[0].tolist() == pytest.approx(
        [math.sin(robot.lean_rad), 0.0, math.cos(robot.lean_rad)]
    )
    assert frame.tangential_over_normal[:3].tolist() == pytest.approx([0.3] * 3)
    assert 0.0 < frame.normal_sigma_rad[0] < 0.1
    assert np.isnan(frame.normal[3:]).all()
    assert [(event.kind, event.leg) for event in robot.events] == [
        (GaitEventKind.TOUCHDOWN, leg) for leg in range(3)
    ]


def test_times_are_back_dated_along_the_flanks() -> None:
    """A rise and a fall of 40 ms: each time is within three of its sigma, and before it was said."""
    robot = Robot()
    robot.step(np.zeros(LEGS), 100)
    begun_ns = robot.now_ns
    for k in range(1, 16):
        robot.step(np.full(LEGS, 0.06 * k))
    robot.step(np.full(LEGS, 0.9), 50)
    for k in range(15, 0, -1):
        robot.step(np.full(LEGS, 0.06 * k))
    ended_ns = robot.now_ns
    frame = robot.step(np.zeros(LEGS), 40)
    # Loads that are known at once are dated back too far, by the usual lag of the readings.
    for t_ns, sigma_s, true_ns in (
        (frame.touchdown_ns, frame.touchdown_sigma_s, begun_ns),
        (frame.lift_off_ns, frame.lift_off_sigma_s, ended_ns),
    ):
        assert abs(t_ns[0] - true_ns) < 3e9 * sigma_s[0] + 5e6
        assert sigma_s[0] < 0.02
    assert len(robot.events) == 2 * LEGS


def test_a_lift_off_is_not_later_than_now() -> None:
    """Even if it is told within the lag by which it is dated later than the load's end."""
    robot = Robot()
    robot.step(np.zeros(LEGS), 100)
    robot.step(np.full(LEGS, 2.0), 100)
    robot.events.clear()
    while not robot.events:
        robot.step(np.full(LEGS, -2.0))
    assert robot.events[0].kind is GaitEventKind.LIFT_OFF
    assert robot.events[0].t_ns <= robot.now_ns


def test_a_force_that_is_not_known_is_no_event() -> None:
    """A leg that falls silent in stance loses its contact and regains it without an event; its lift-off is one."""
    robot = Robot()
    robot.step(np.zeros(LEGS), 100)
    forces_n = np.full(LEGS, 1.0)
    robot.step(forces_n, 20)
    robot.events.clear()
    forces_n[2] = np.nan
    frame = robot.step(forces_n, 200)
    assert not robot.events
    assert not frame.contact[2]
    assert math.isnan(robot.tracker.contact_probability[2])
    assert math.isnan(robot.tracker.holds[2])
    assert np.isnan(frame.load_share[2])
    assert not frame.all_in_air
    frame = robot.step(np.full(LEGS, 1.0), 20)
    assert frame.contact.all()
    assert not robot.events
    assert (frame.touchdown_ns[2], frame.lift_off_ns[2]) == (0, 0)
    robot.step(np.where(np.arange(LEGS) == 2, 0.0, 1.0), 40)
    assert [(event.kind, event.leg) for event in robot.events] == [(GaitEventKind.LIFT_OFF, 2)]


@pytest.mark.parametrize("n_unknown", [1, 20])
def test_a_touch_while_the_force_is_not_known_is_told_when_it_is(n_unknown: int) -> None:
    """As of a foot that saturates as it lands: one touchdown, as uncertain as the silence is long, and one lift-off."""
    robot = Robot()
    robot.step(np.zeros(LEGS), 100)
    begun_ns = robot.now_ns
    hidden_n = np.full(LEGS, np.nan)
    for _ in range(n_unknown):
        robot.step(hidden_n, mean_n=np.full(LEGS, 1.0))
    assert not robot.events
    robot.step(np.full(LEGS, 1.0), 30)
    [touchdown_of_leg] = [event for event in robot.events if event.leg == 2]
    assert touchdown_of_leg.kind is GaitEventKind.TOUCHDOWN
    assert abs(touchdown_of_leg.t_ns - begun_ns) < 20_000_000 + n_unknown * STEP_NS
    assert touchdown_of_leg.sigma_s >= 0.5e-9 * n_unknown * STEP_NS
    robot.step(np.zeros(LEGS), 40)
    assert [event.kind for event in robot.events if event.leg == 2] == [
        GaitEventKind.TOUCHDOWN,
        GaitEventKind.LIFT_OFF,
    ]


def test_a_contact_that_is_over_when_the_force_is_known_again_was_none() -> None:
    """As of readings that contradict one another, of a foot in the air."""
    robot = Robot()
    robot.step(np.zeros(LEGS), 100)
    robot.step(np.full(LEGS, np.nan), mean_n=np.full(LEGS, 0.08))
    robot.step(np.zeros(LEGS), 40)
    assert not robot.events


def test_a_start_in_stance_is_no_touchdown() -> None:
    """Feet that carry when their force is first known have touched before; what a restart sees is no event."""
    robot = Robot()
    frame = robot.step(np.full(LEGS, 1.0), 50)
    assert frame.contact.all()
    assert not robot.events
    assert (frame.touchdown_ns == 0).all()


def test_a_slide_is_said_once_and_ends_with_the_stance() -> None:
    """Begin and end of a slip at the configured coefficient, the end at the lift-off."""
    robot = Robot(friction=0.4)
    robot.step(np.zeros(LEGS), 100)
    robot.step(np.full(LEGS, 1.0), 10)
    robot.events.clear()
    assert min(robot.tracker.holds) > 0.6
    robot.ratio = 0.4
    frame = robot.step(np.full(LEGS, 1.0), 60)
    assert sorted((event.kind, event.leg) for event in robot.events) == [
        (GaitEventKind.SLIP, leg) for leg in range(LEGS)
    ]
    assert (frame.slip == Slip.SLIPPING).all()
    assert max(robot.tracker.holds) < 0.1
    assert frame.friction == 0.4
    robot.events.clear()
    robot.step(np.zeros(LEGS), 40)
    assert [event.kind for event in robot.events if event.leg == 0] == [
        GaitEventKind.SLIP_END,
        GaitEventKind.LIFT_OFF,
    ]


def test_frames_come_with_events_and_ten_times_a_second() -> None:
    """Between them nothing is published."""
    tracker = GaitTracker(1)
    contact = ContactDetector(0.03, 0.5e-3, 0.025)
    found = []
    for k in range(1000):
        now_ns = k * STEP_NS
        force_n = 1.0 if k > 500 else 0.0
        contact.observe(force_n, 0.001, now_ns, now_ns, force_n)
        load = LoadEstimate(
            np.array([[0.0, 0.0, force_n]]), np.full((1, 3), 1e-3), np.zeros((1, 4)), np.full((1, 4), SIGMA)
        )
        frame = tracker.observe(load, [contact], now_ns)
        if frame is not None:
            found.append(frame)
    assert sum(bool(frame.events) for frame in found) == 1
    assert len(found) == 1 + 1 + 999 * STEP_NS // 100_000_000


class AnyGait(RuleBasedStateMachine):
    """Loads of any kind, silences included."""

    def __init__(self) -> None:
        super().__init__()
        self.robot = Robot()
        self.frame = self.robot.step(np.zeros(LEGS))
        self.silent: set[int] = set()

    @rule(
        leg=st.integers(0, LEGS - 1),
        load_n=st.sampled_from([0.0, 0.01, 0.02, 0.04, 0.3, 2.0, -0.1, math.nan]),
        n=st.integers(1, 25),
        ratio=st.floats(0.0, 0.6),
    )
    def carry(self, leg: int, load_n: float, n: int, ratio: float) -> None:
        """Load one leg, the others not at all."""
        self.robot.ratio = ratio
        if math.isnan(load_n):
            self.silent.add(leg)
        self.frame = self.robot.step(np.where(np.arange(LEGS) == leg, load_n, 0.0), n)

    @invariant()
    def events_alternate_in_time(self) -> None:
        """No touchdown within contact, no lift-off without one but of legs that were silent, each later than before."""
        for leg in set(range(LEGS)) - self.silent:
            flanks = {GaitEventKind.TOUCHDOWN, GaitEventKind.LIFT_OFF}
            own = [event for event in self.robot.events if event.leg == leg and event.kind in flanks]
            lifts = [event for event in own if event.kind == GaitEventKind.LIFT_OFF]
            for before, event in itertools.pairwise(own):
                assert event.t_ns > before.t_ns
                assert before.kind != event.kind
            assert len(lifts) <= len(own) - len(lifts)

    @invariant()
    def values_are_possible(self) -> None:
        """Probabilities and shares are in [0, 1]; normals are units; nothing is known of a foot in the air."""
        frame = self.frame
        tracker = self.robot.tracker
        for shares in (tracker.contact_probability, tracker.holds, frame.load_share):
            share = np.asarray(shares)
            known = share[np.isfinite(share)]
            assert ((known >= 0.0) & (known <= 1.0)).all()
        if np.isfinite(frame.load_share).any():
            assert np.nansum(frame.load_share) == pytest.approx(1.0)
        length = np.linalg.norm(frame.normal, axis=1)
        assert np.allclose(length[np.isfinite(length)], 1.0)
        assert np.isnan(frame.tangential_over_normal[~frame.contact]).all()
        assert not (frame.all_in_air and frame.contact.any())


TestAnyGait = AnyGait.TestCase
TestAnyGait.settings = settings(max_examples=15, stateful_step_count=12, deadline=None)
