"""The invariants of a long walk notice what they are there for, and excuse what they should."""

from typing import Any, get_args

import numpy as np
import pytest

from firmware_interface.can.force import FORCE_ID, QUALITY_ID
from firmware_interface.can.socketcan import pack_frame
from footsense.config import DEFAULT, SMALL_BOARD
from footsense.frames import (
    LEGS,
    Command,
    CommandKind,
    CommandResult,
    Cycle,
    Flag,
    GaitEvent,
    GaitEventKind,
    Result,
    State,
)
from footsense.sim.faults.scene_faults import (
    Absent,
    BrokenColumn,
    CanDown,
    ChannelsShifted,
    ColumnShift,
    ElementDrifts,
    Fault,
    MetalBesideTail,
    NackAtRandom,
    StuckSda,
    Tone,
)
from footsense.validation.invariants import InvariantChecker
from footsense.validation.soak_faults import soak_faults
from footsense.validation.tolerances import MeasuredWorst, WalkLimits
from tests.support.can_frames import encode_force, encode_quality
from tests.support.frames import contact_frame, gait_frame

MS = 1_000_000
#: Six legs that step all at once: half a second in the air, half a second on the ground.
RULES = WalkLimits(
    legs=LEGS,
    buses=(LEGS[:3], LEGS[3:]),
    cycle_period_s=0.024,
    scan_s=0.024,
    max_age_s=0.09,
    cycles_per_can_force=1,
    bit_s=2e-6,
    worst=MeasuredWorst(
        detection_s=0.02,
        recovery_s=0.9,
        gap_s=0.07,
        stopped_bus_gap_s=0.8,
        error_n=0.05,
        unseen=frozenset({(MetalBesideTail, 0.0)}),
        frame_s=0.024,
    ),
    swings_s=tuple(tuple((float(s), s + 0.5) for s in range(20)) for _ in LEGS),
    largest_n=1.0,
)


def watching(*script: Fault, true_n: float = 0.0) -> InvariantChecker:
    return InvariantChecker(RULES, script, lambda _: np.full((6, 3), true_n))


def cycle(number: int, state: State = State.VALID, leg: int = 1, **changed: Any) -> Cycle:
    """One of the cycles 24 ms apart in which a leg has a state, and all others a good force of zero."""
    states = np.full(6, State.VALID, np.uint8)
    states[leg] = state
    force_n = np.zeros((6, 3))
    force_n[~np.isin(states, (State.VALID, State.DEGRADED))] = np.nan
    t_ns = changed.pop("sent_ns", 24 * MS * (number + 1))
    given = {"t_ns": t_ns - 12 * MS, "force_n": force_n, "sigma_n": force_n + 0.01, "state": states}
    return Cycle(None, (), contact_frame(t_ns, 6, sequence=number, **given | changed), ())  # type: ignore[arg-type]


def violated(seen: InvariantChecker) -> set[str]:
    return set(seen.n_violations)


def test_a_walk_in_which_all_is_well_loses_nothing() -> None:
    """And its errors are counted as within two sigma."""
    seen = watching()
    for number in range(200):
        seen.observe(cycle(number))
    seen.end(4.8, unanswered=[], ring_problem="", grown_mib=0.0)
    assert (violated(seen), seen.n_cycles, seen.n_checked, seen.n_within) == (set(), 200, 1200, 3600)


@pytest.mark.parametrize(
    ("second", "rule"),
    [
        (cycle(2), "no frame is left out"),
        (cycle(1, sent_ns=60 * MS), "frames keep coming on time"),
        (cycle(1, sent_ns=24 * MS), "frames keep coming on time"),
        (cycle(1, force_n=np.full((6, 3), np.nan)), "a number if and only if the state allows one"),
        (
            cycle(1, State.STALE, force_n=np.zeros((6, 3)), sigma_n=np.ones((6, 3))),
            "a number if and only if the state allows one",
        ),
        (cycle(1, t_ns=np.full(6, -43 * MS)), "no force above its age limit"),
        (cycle(1, t_ns=np.full(6, 11 * MS)), "stamps go forward, up to now"),
        (cycle(1, t_ns=np.full(6, 49 * MS)), "stamps go forward, up to now"),
    ],
)
def test_what_must_not_be_is_noticed(second: Cycle, rule: str) -> None:
    """A frame left out, late, or twice at the same time; a number that should not be, or should; a wrong stamp."""
    seen = watching()
    seen.observe(cycle(0))
    seen.observe(second)
    assert rule in violated(seen)


@pytest.mark.parametrize(
    ("fault", "noticed_s"),
    [
        # Its end, the table's longest recovery, and the next swing that begins then.
        (Absent(leg="lm", at_s=0.6, until_s=1.1), 2.5),
        (Absent(leg="rm", at_s=0.6, until_s=1.1), 0.6 + 0.07),
        (StuckSda(leg="lf", at_s=0.6, until_s=1.1), 2.5),
        (StuckSda(leg="rm", at_s=0.6, until_s=1.1), 0.6 + 0.8),
        (CanDown(at_s=0.6, until_s=1.1), 0.6),
    ],
)
def test_a_leg_is_tolerated_for_what_breaks_on_it_or_its_bus(fault: Fault, noticed_s: float) -> None:
    """For no longer than the table of faults has measured, and until the swing after that."""
    seen = watching(fault)
    number = 0
    while not seen.violations:
        seen.observe(cycle(number, State.ABSENT if number >= 24 else State.VALID))
        number += 1
    assert seen.violations[0].invariant == "no force is missing without cause"
    assert seen.violations[0].t_s == pytest.approx(noticed_s + 0.04, abs=0.03)


@pytest.mark.parametrize(
    ("script", "wrong_n", "noticed_s"),
    [
        ([], 0.06, 0.1),
        ([], 0.04, None),
        ([Tone(legs=("lm",), at_s=0.1, until_s=9.0, amplitude_ff=50.0, frequency_hz=61.0)], 0.06, 0.1),
        # A shift shows in the next swing.
        ([ColumnShift(legs=("lf",), at_s=0.01, until_s=2.2, amplitude_ff=50.0, column=1)], 0.06, 1.6),
        ([BrokenColumn(leg="lf", at_s=0.01, until_s=2.2, column=1)], 0.06, 1.6),
        # One that reads as a load in the air, in that after its end.
        ([MetalBesideTail(legs=("lf",), at_s=0.01, until_s=1.1)], 0.06, None),
    ],
)
def test_a_force_that_stays_wrong_is_noticed(
    script: list[Fault], wrong_n: float, noticed_s: float | None
) -> None:
    """Beyond three sigmas and what the table has measured of healthy legs, for longer than three scans."""
    seen = watching(*script)
    force_n = np.zeros((6, 3))
    force_n[0, 1] = wrong_n
    for number in range(90):
        seen.observe(cycle(number, leg=0, state=State.DEGRADED, force_n=force_n))
    times_s = [violation.t_s for violation in seen.violations]
    assert times_s == ([pytest.approx(noticed_s, abs=0.03)] if noticed_s else [])


def test_a_force_that_is_wrong_now_and_then_is_not_noticed() -> None:
    """Its time begins anew after each right one."""
    seen = watching()
    for number in range(90):
        force_n = np.zeros((6, 3))
        force_n[0, 1] = 0.06 * (number % 3 > 0)
        seen.observe(cycle(number, leg=0, force_n=force_n))
    assert violated(seen) == set()


@pytest.mark.parametrize(
    ("fault", "state", "noticed"),
    [
        (BrokenColumn(leg="lm", at_s=0.1, until_s=0.6, column=1), State.VALID, True),
        (BrokenColumn(leg="lm", at_s=0.1, until_s=0.6, column=1), State.DEGRADED, False),
        (BrokenColumn(leg="rf", at_s=5.1, until_s=5.6, column=1), State.VALID, False),
    ],
)
def test_a_broken_foot_must_not_be_valid(fault: Fault, state: State, *, noticed: bool) -> None:
    """Once the time is over in which the table's broken elements were found."""
    seen = watching(fault)
    for number in range(90):
        seen.observe(cycle(number, state))
    assert ("no broken foot is Valid" in violated(seen)) is noticed
    assert not noticed or seen.violations[0].t_s == pytest.approx(0.15, abs=0.03)


@pytest.mark.parametrize(
    ("true_n", "sigma_n", "flags", "rule"),
    [
        (0.0, 0.01, Flag.CONTACT, "a foot in the air is not in contact"),
        (0.5, 0.01, 0, "a foot that carries is in contact"),
        (0.5, 0.3, 0, None),  # by its sigma it may carry nothing
        (0.5, 0.01, Flag.CONTACT, None),
        (0.0, 0.01, 0, None),
    ],
)
def test_a_contact_that_stays_wrong_is_noticed(
    true_n: float, sigma_n: float, flags: int, rule: str | None
) -> None:
    seen = watching(true_n=true_n)
    told: dict[str, Any] = {
        "force_n": np.full((6, 3), true_n),
        "sigma_n": np.full((6, 3), sigma_n),
        "flags": flags,
    }
    for number in range(3):
        seen.observe(cycle(number, **told))
    assert violated(seen) == set()
    for number in range(3, 6):
        seen.observe(cycle(number, **told))
    assert violated(seen) == ({rule} if rule else set())


@pytest.mark.parametrize(
    ("script", "event", "rule"),
    [
        ([], GaitEvent(GaitEventKind.TOUCHDOWN, 0, 14 * MS, 0.002), "no foot in the air touches"),
        ([], GaitEvent(GaitEventKind.SLIP, 0, 14 * MS, 0.002), "no foot in the air touches"),
        ([], GaitEvent(GaitEventKind.LIFT_OFF, 0, 14 * MS, 0.002), None),
        ([], GaitEvent(GaitEventKind.LIFT_OFF, 0, 25 * MS, 0.002), "no event is of the future"),
        (
            [BrokenColumn(leg="lf", at_s=0.01, until_s=2.0, column=1)],
            GaitEvent(GaitEventKind.TOUCHDOWN, 0, 14 * MS, 0.002),
            None,
        ),
    ],
)
def test_an_event_that_cannot_be_is_noticed(script: list[Fault], event: GaitEvent, rule: str | None) -> None:
    """A touch in the air, unless something that moves the readings happened to the leg; one of the future."""
    seen = watching(*script)
    seen.observe(cycle(0, gait=gait_frame(24 * MS, 6, events=(event,))))
    assert violated(seen) == ({rule} if rule else set())


def test_a_stopped_leg_is_silent_until_it_is_started() -> None:
    """Its silence needs no cause; a force of it is a violation."""
    seen = watching()

    def commanded(number: int, state: State, *kinds: CommandKind) -> None:
        done = tuple(CommandResult(Command(kind, 1), Result.DONE, "") for kind in kinds)
        seen.observe(cycle(number, state)._replace(ended_commands=done))

    commanded(0, State.VALID)
    commanded(1, State.STOPPED, CommandKind.STOP)
    for number in range(2, 30):
        commanded(number, State.STOPPED)
    assert violated(seen) == set()
    commanded(30, State.VALID)
    assert violated(seen) == {"a stopped leg has no force"}
    commanded(31, State.VALID, CommandKind.START)
    for number in range(32, 40):
        commanded(number, State.STOPPED)
    assert violated(seen) == {"a stopped leg has no force", "no force is missing without cause"}


def test_the_end_of_a_walk_is_checked() -> None:
    """Commands without an answer, unless CAN was broken; the ring; memory; sigmas that are too small."""
    seen = watching(CanDown(at_s=5.0, until_s=5.1))
    for number in range(10):
        seen.observe(cycle(number, force_n=np.full((6, 3), 0.03)))
    seen.end(9.0, unanswered=[("lf", 4500 * MS)], ring_problem="", grown_mib=1.0)
    assert violated(seen) == {"sigma covers the errors"}
    seen.end(9.0, unanswered=[("lf", 1500 * MS)], ring_problem="no cycles", grown_mib=9.0)
    assert violated(seen) == {
        "sigma covers the errors",
        "every command has an answer",
        "the ring has the last second",
        "memory does not grow",
    }


def hear(seen: InvariantChecker, counter: int, t_ms: int, wait_ms: int = 1, age_ms: int = 12) -> None:
    force = pack_frame(FORCE_ID + 2, encode_force(2, counter, State.VALID, (0.0, 0.0, 1.0)))
    quality = pack_frame(QUALITY_ID + 2, encode_quality(2, counter, 0, age_ms * MS, (0.01, 0.01, 0.01)))
    for frame in (force, quality):
        seen.on_delivered(t_ms * MS, (t_ms - wait_ms) * MS, frame)


def test_what_is_missing_or_late_on_can_is_noticed() -> None:
    """A frame that never came, unless CAN was broken; one that waited; an age that is not that of its cycle."""
    seen = watching(CanDown(at_s=5.0, until_s=5.1))
    seen.observe(cycle(0))
    for counter, t_ms in [(14, 25), (0, 49), (2, 96)]:
        hear(seen, counter, t_ms)
    assert (dict(seen.n_violations), seen.n_missed, seen.n_received) == ({"every frame reaches CAN": 1}, 1, 3)
    hear(seen, 3, 4990)
    hear(seen, 8, 5200)
    assert (seen.n_violations.total(), seen.n_missed) == (1, 5)
    hear(seen, 9, 5300, wait_ms=80)
    hear(seen, 10, 25, age_ms=13)
    assert violated(seen) - {"every frame reaches CAN"} == {
        "no frame waits longer than in a full queue",
        "the age on CAN is that of the force",
    }


def test_every_fault_of_the_tables_comes_and_passes() -> None:
    """On either board, within its time; a drift is taken back."""
    kinds: set[type] = set()
    for config in (DEFAULT, SMALL_BOARD):
        script = soak_faults(np.random.default_rng(1), config, 10.0, 2_000.0)
        kinds |= {type(fault) for fault in script}
        assert all(
            fault.at_s >= 10.0 and (getattr(fault, "until_s", 0.0) or 0.0) < 2_000.0 for fault in script
        )
        assert all(getattr(fault, "until_s", 1.0) for fault in script)
        drifted_ff = [
            fault.rate_ff_per_s * (fault.until_s - fault.at_s)
            for fault in script
            if isinstance(fault, ElementDrifts) and fault.until_s is not None
        ]
        assert sum(drifted_ff) == pytest.approx(0.0, abs=0.5)
    assert set(get_args(Fault)) - kinds == {ChannelsShifted}
    assert NackAtRandom in kinds
