"""The invariants of a long walk notice what they are there for, and excuse what they should."""

from typing import Any

import numpy as np
import pytest

from firmware_interface.can.force import FORCE_ID, QUALITY_ID
from firmware_interface.can.socketcan import pack_frame
from footsense.frames import LEGS, Cycle, GaitEvent, GaitEventKind, State
from footsense.sim.faults.scene_faults import (
    Absent,
    BrokenRow,
    CanDown,
    ChannelsShifted,
    ColumnShift,
    ElementDrifts,
    Fault,
    StuckSda,
    Tone,
    WhiteNoise,
)
from footsense.validation.invariants import InvariantChecker
from footsense.validation.random_faults import random_faults
from footsense.validation.tolerances import WalkLimits
from tests.support.can_frames import encode_force, encode_quality
from tests.support.frames import contact_frame, gait_frame

MS = 1_000_000
RULES = WalkLimits(
    legs=LEGS,
    cycle_period_s=0.024,
    max_age_s=0.09,
    gait_period_s=1.0,
    checks_start_s=0.0,
    cycles_per_can_force=1,
)


def watching(*script: Fault, rules: WalkLimits = RULES) -> InvariantChecker:
    return InvariantChecker(rules, script, lambda _: np.zeros((6, 3)))


def cycle(number: int, t_ms: float, state: State = State.VALID, **changed: Any) -> Cycle:
    """One cycle in which the second leg has a state, and all others a good force."""
    states = np.full(6, State.VALID, np.uint8)
    states[1] = state
    force_n = np.zeros((6, 3))
    force_n[states != State.VALID] = np.nan
    t_ns = round(t_ms * MS)
    given = {
        "t_ns": t_ns - 12 * MS,
        "force_n": force_n,
        "sigma_n": force_n + 0.01,
        "state": states,
        **changed,
    }
    return Cycle(None, (), contact_frame(t_ns, 6, sequence=number, **given), ())  # type: ignore[arg-type]


def violated(seen: InvariantChecker) -> set[str]:
    return set(seen.n_violations)


def test_a_walk_in_which_all_is_well_loses_nothing() -> None:
    """And an error of a fifth of its sigma is counted as one that is not beyond five."""
    seen = watching()
    for number in range(200):
        seen.observe(cycle(number, 24.0 * (number + 1)))
    assert (violated(seen), seen.n_cycles, seen.n_checked, seen.n_beyond.tolist()) == (
        set(),
        200,
        1200,
        [0, 0, 0],
    )


@pytest.mark.parametrize(
    ("second", "rule"),
    [
        (cycle(2, 48.0), "no frame is left out"),
        (cycle(1, 60.0), "frames keep coming on time"),
        (cycle(1, 24.0), "frames keep coming on time"),
        (cycle(1, 48.0, force_n=np.full((6, 3), np.nan)), "a number if and only if the state allows one"),
        (
            cycle(1, 48.0, State.STALE, force_n=np.zeros((6, 3)), sigma_n=np.ones((6, 3))),
            "a number if and only if the state allows one",
        ),
        (cycle(1, 48.0, t_ns=np.full(6, -43 * MS)), "no force above its age limit"),
    ],
)
def test_what_must_not_be_is_noticed(second: Cycle, rule: str) -> None:
    """A frame left out, late, or twice at the same time; a number that should not be, or should; an old one."""
    seen = watching()
    seen.observe(cycle(0, 24.0))
    seen.observe(second)
    assert rule in violated(seen)


@pytest.mark.parametrize(
    ("fault", "tolerated"),
    [
        (Absent(leg="lm", at_s=0.02, until_s=0.1), True),
        (Absent(leg="rm", at_s=0.02, until_s=0.1), False),
        (StuckSda(leg="rm", at_s=0.02, until_s=0.1), False),
        (CanDown(at_s=0.02, until_s=0.1), False),
    ],
)
def test_a_leg_is_tolerated_for_what_breaks_on_it_alone(fault: Fault, *, tolerated: bool) -> None:
    """Until it must be well again: the pause before it is tried again, and a swing to be tared in."""
    seen = watching(fault)
    assert seen.recovered_s == pytest.approx({True: 0.1 + 0.08 + 1.0 + 3.0}.get(tolerated, seen.recovered_s))
    for number in range(40):
        seen.observe(cycle(number, 24.0 * (number + 1), State.ABSENT))
    assert ("the other legs go on" in violated(seen)) is not tolerated
    for number in range(40, 200):
        seen.observe(cycle(number, 24.0 * (number + 1), State.ABSENT))
    assert "the other legs go on" in violated(seen)


@pytest.mark.parametrize(
    ("script", "wrong_n", "after_s"),
    [
        ([], 0.06, 0.0),
        ([Tone(legs=("lf", "lm"), at_s=0.1, until_s=9.0, amplitude_ff=50.0, frequency_hz=61.0)], 0.06, 0.0),
        ([ColumnShift(legs=("rm",), at_s=0.1, until_s=9.0, amplitude_ff=50.0, column=1)], 0.06, 0.0),
        ([ColumnShift(legs=("lf",), at_s=0.1, until_s=9.0, amplitude_ff=50.0, column=1)], 0.06, 1.6),
        ([ChannelsShifted(legs=("lf",), at_s=0.1, until_s=2.0)], 0.06, 3.5),
        ([ChannelsShifted(legs=("lf",), at_s=0.1, until_s=2.0)], 0.5, 0.0),
    ],
)
def test_a_force_that_stays_wrong_is_noticed(script: list[Fault], wrong_n: float, after_s: float) -> None:
    """Beyond five sigmas for longer than a scan takes; after a shift, when a swing has shown the baseline."""
    seen = watching(*script)
    force_n = np.zeros((6, 3))
    force_n[0, 1] = wrong_n
    for number in range(200):
        now = cycle(number, 24.0 * (number + 1), force_n=force_n, sigma_n=np.full((6, 3), 0.01))
        seen.observe(now)
        if seen.violations:
            break
    assert violated(seen) - {"the other legs go on"} == {"no force is wrong for long"}
    assert seen.violations[-1].t_s == pytest.approx(after_s + 0.3, abs=0.05)


@pytest.mark.parametrize(
    ("script", "kind", "noticed"),
    [
        ([], GaitEventKind.TOUCHDOWN, True),
        ([], GaitEventKind.SLIP, True),
        ([], GaitEventKind.LIFT_OFF, False),
        ([BrokenRow(leg="lf", at_s=0.5, until_s=2.0, row=1)], GaitEventKind.TOUCHDOWN, False),
        ([BrokenRow(leg="lf", at_s=0.1, until_s=2.0, row=1)], GaitEventKind.TOUCHDOWN, True),
        ([BrokenRow(leg="rf", at_s=0.5, until_s=2.0, row=1)], GaitEventKind.TOUCHDOWN, True),
        ([WhiteNoise(legs=("lf",), at_s=0.1, until_s=2.0, noise_ff=9.0)], GaitEventKind.TOUCHDOWN, False),
    ],
)
def test_a_touchdown_in_the_air_is_noticed(
    script: list[Fault], kind: GaitEventKind, *, noticed: bool
) -> None:
    """Unless something that moves the readings at once, as a touchdown does, happened to the leg."""
    seen = watching(*script)
    event = GaitEvent(kind, 0, 590 * MS, 0.002)
    seen.observe(cycle(0, 600.0, gait=gait_frame(600 * MS, 6, events=(event,))))
    assert ("no foot in the air touches" in violated(seen)) is noticed


def hear(seen: InvariantChecker, counter: int, t_ms: int, wait_ms: int = 1, age_ms: int = 12) -> None:
    force = pack_frame(FORCE_ID + 2, encode_force(2, counter, State.VALID, (0.0, 0.0, 1.0)))
    quality = pack_frame(QUALITY_ID + 2, encode_quality(2, counter, 0, age_ms * MS, (0.01, 0.01, 0.01)))
    for frame in (force, quality):
        seen.on_delivered(t_ms * MS, (t_ms - wait_ms) * MS, frame)


def test_what_is_missing_or_late_on_can_is_noticed() -> None:
    """A frame that never came, unless CAN was broken; one that waited; one that is old."""
    seen = watching(CanDown(at_s=5.0, until_s=5.1))
    for counter, t_ms in [(0, 24), (1, 48), (3, 96)]:
        hear(seen, counter, t_ms)
    assert (dict(seen.n_violations), seen.n_missed, seen.n_received) == ({"every frame reaches CAN": 1}, 1, 3)
    hear(seen, 4, 4990)
    hear(seen, 9, 5200)
    assert (seen.n_violations.total(), seen.n_missed) == (1, 5)
    hear(seen, 10, 5300, wait_ms=80)
    hear(seen, 11, 5400, age_ms=200)
    assert violated(seen) - {"every frame reaches CAN"} == {
        "no frame waits longer than in a full queue",
        "nothing old leaves the wire",
    }


def test_a_stand_puts_off_the_tare() -> None:
    """A leg that comes back while the robot stands is tared when it walks again."""
    seen = watching(
        Absent(leg="lm", at_s=100.0, until_s=101.0),
        rules=RULES._replace(standstill_spans_s=((90.0, 1000.0),)),
    )
    assert seen.recovered_s == pytest.approx(1000.0 + 2.0 + 1.0 + 1.0 + 3.0, abs=1.0)


def test_random_faults_all_pass() -> None:
    """Every kind comes, within its time; a drift is taken back."""
    script = random_faults(np.random.default_rng(1), LEGS, 10.0, 10_000.0)
    assert len({type(fault) for fault in script}) == 35
    assert all(fault.at_s >= 10.0 and (getattr(fault, "until_s", 0.0) or 0.0) < 10_000.0 for fault in script)
    drifts = [fault for fault in script if isinstance(fault, ElementDrifts)]
    drifted_ff = [
        fault.rate_ff_per_s * (fault.until_s - fault.at_s) for fault in drifts if fault.until_s is not None
    ]
    assert sum(drifted_ff) == pytest.approx(0.0, abs=0.5)
