"""What breaks shows as the right state and cause, passes by itself, and touches no other leg.

The host costs nothing in these walks, so that no transaction more or less moves a conversion, and "untouched" can be
taken at its word: the other legs' readings and states are the same bits at the same times as in a walk in which nothing
breaks. Forces are those of the time of sending, which the transactions with the broken leg do move.
"""

from functools import cache
from typing import Any

import msgspec
import numpy as np
import pytest

from footsense.config import SMALL_BOARD
from footsense.config.sections import Mux
from footsense.frames import USABLE, Cause, State
from footsense.sim.faults import scene_faults
from footsense.sim.faults.scene_faults import Fault
from footsense.sim.scene import Effects
from footsense.validation.fault_table import LEG_FAULT_TRIALS
from footsense.validation.fault_trial import (
    BREAKS_AT_S,
    FAULTY_LEG,
    PASSES_AT_S,
    WALK_SCENE,
    FaultFigures,
    PublishedWalk,
    fault_figures,
    simulate_walk,
)

#: A leg of each tripod, and the one on which things break.
ROBOT = msgspec.structs.replace(
    SMALL_BOARD, buses=(msgspec.structs.replace(SMALL_BOARD.buses[0], legs={"lf": 0, "lm": 1, "rm": 4}),)
)

#: Two scans: a line may break after its own elements were read, and it takes a second whole scan to tell motion.
SCANS_S = 0.055
ALL = 0b111_111_111

ON_LEG: dict[str, Any] = {"at_s": BREAKS_AT_S, "leg": FAULTY_LEG}
PASSING: dict[str, Any] = {**ON_LEG, "until_s": PASSES_AT_S}


#: After a cable was off, the leg waits for its next swing to be tared; others wait at most for their next try.
PROBED_S, TARED_S = 0.5, 1.2
#: An element has to agree again for 0.3 s loaded and as long free.
TRUSTED_S = 1.0

#: What has to become of a row of the fault table: state, cause, elements, and within how many seconds it shows and is
#: over; None for never.
EXPECTED: dict[str, tuple[State, Cause, int, float, float | None]] = {
    "cable off and on": (State.ABSENT, Cause.NO_ANSWER, ALL, SCANS_S, TARED_S),
    "conversions never finish": (State.CONVERTER_FAULT, Cause.NEVER_FINISHES, ALL, SCANS_S, PROBED_S),
    **dict.fromkeys(
        (
            row.description
            for row in LEG_FAULT_TRIALS
            if "hangs" in row.description and SMALL_BOARD.board in row.boards
        ),
        (State.CONVERTER_FAULT, Cause.NEVER_FINISHES, ALL, 0.025, PROBED_S),
    ),
    "another chip at the address": (State.ABSENT, Cause.WRONG_CHIP, ALL, SCANS_S, TARED_S),
    "supply dips: all settings lost": (State.CONVERTER_FAULT, Cause.SETTINGS_LOST, ALL, SCANS_S, PROBED_S),
    "row switch ignores writes": (State.CONVERTER_FAULT, Cause.SETTINGS_LOST, ALL, SCANS_S, PROBED_S),
    "element open": (State.DEGRADED, Cause.ELEMENT_OPEN, 0b000_010_000, SCANS_S, 0.1),
    "element shorted": (State.DEGRADED, Cause.ELEMENT_SHORTED, 0b001_001_001, SCANS_S, 0.1),
    "element shorted, another stuck": (
        State.DEGRADED,
        Cause.ELEMENT_SHORTED,
        0b001_001_001,
        SCANS_S,
        0.1,
    ),
    # It stays as it was in the middle of the stance: that shows when the others let go.
    "element stuck": (State.DEGRADED, Cause.ELEMENT_STUCK, 0b000_000_001, 0.3, TRUSTED_S),
    "element drifts, 0.5 pF/s": (State.DEGRADED, Cause.ELEMENT_DRIFTS, 0b000_000_001, 0.5, None),
    "gap full of water": (State.DEGRADED, Cause.ELEMENT_SHORTED, 0b000_100_000, SCANS_S, TRUSTED_S),
    "row line broken": (State.DEGRADED, Cause.ROW_OPEN, 0b000_111_000, SCANS_S, 0.1),
    "column line broken": (State.DEGRADED, Cause.COLUMN_OPEN, 0b010_010_010, SCANS_S, 0.1),
    # More than can be estimated.
    "two row lines broken": (State.ELEMENT_FAULT, Cause.ROW_OPEN, 0b111_000_111, SCANS_S, TRUSTED_S),
}


@cache
def whole_walk(effects: Effects) -> PublishedWalk:
    """Return the walk in which nothing breaks."""
    return simulate_walk(config=ROBOT, effects=effects)


@pytest.fixture(scope="module")
def whole() -> PublishedWalk:
    return whole_walk(WALK_SCENE.effects)


def trial(fault: Fault, whole: PublishedWalk) -> tuple[PublishedWalk, FaultFigures]:
    broken = simulate_walk(fault, config=ROBOT)
    return broken, fault_figures(broken, whole, fault.at_s, getattr(fault, "until_s", None))


def touches_no_other_leg(broken: PublishedWalk, whole: PublishedWalk) -> bool:
    others = [row for row, leg in enumerate(whole.legs) if leg != FAULTY_LEG]
    n = min(len(broken.t_sent_ns), len(whole.t_sent_ns))
    same = [
        np.array_equal(getattr(broken, name)[:n, others], getattr(whole, name)[:n, others], equal_nan=True)
        for name in ("t_ns", "state", "cause")
    ]
    other_n = np.nan_to_num(np.abs(broken.force_n[:n, others] - whole.force_n[:n, others]))
    at_once = broken.t_sent_ns[:n] == whole.t_sent_ns[:n]
    # The zeros of those in the air follow in turn: with one less, a turn comes sooner.
    close = other_n <= np.where(at_once[:, None, None], 1e-5, np.nan_to_num(whole.sigma_n[:n, others]))
    return len(whole.t_sent_ns) - n <= 1 and all(same) and bool(close.all())


@pytest.mark.parametrize("description", EXPECTED)
def test_a_fault_is_named_passes_and_touches_no_other_leg(description: str) -> None:
    """State, cause and elements as the table has them, in time; never a number where the state forbids one."""
    (row,) = (row for row in LEG_FAULT_TRIALS if row.description == description)
    broken, whole = simulate_walk(*row.script, config=ROBOT, effects=row.effects), whole_walk(row.effects)
    seen = fault_figures(broken, whole, BREAKS_AT_S, row.fault_end_s)
    state, cause, fault_mask, shown_s, recovered_s = EXPECTED[description]
    # By one reading or two an element that stays as it was counts as one that moves too little.
    causes = {cause, Cause.ELEMENT_DRIFTS} if cause is Cause.ELEMENT_STUCK else {cause}
    assert (seen.state, seen.fault_mask) == (state, fault_mask)
    assert seen.cause in causes
    assert seen.detection_s is not None
    assert seen.detection_s <= shown_s
    assert (seen.recovery_s is None) == (recovered_s is None)
    assert (seen.recovery_s or 0.0) <= (recovered_s or 0.0)
    assert touches_no_other_leg(broken, whole)
    forbidden = ~np.isin(broken.state, [int(state) for state in USABLE])
    assert np.isnan(broken.force_n[forbidden]).all()
    assert np.isfinite(broken.force_n[~forbidden]).all()


def test_what_is_left_of_a_foot_is_worth_having(whole: PublishedWalk) -> None:
    """Without a row the force is off by less than a tenth of the load, and its sigma is larger."""
    broken = simulate_walk(scene_faults.BrokenRow(row=1, **ON_LEG), config=ROBOT)
    row = whole.legs.index(FAULTY_LEG)
    late = broken.t_sent_ns > (BREAKS_AT_S + 0.15) * 1e9
    error_n = (broken.force_n - broken.true_force_n)[late, row]
    assert (broken.state[late, row] == State.DEGRADED).all()
    assert np.sqrt(np.mean(error_n[:, 2] ** 2)) < 0.1
    assert (np.median(broken.sigma_n[late, row] / whole.sigma_n[late, row], axis=0) > 1.0).all()
    assert np.mean(np.abs(error_n) <= 5.0 * broken.sigma_n[late, row]) > 0.95


def test_a_leg_that_holds_the_bus_costs_the_others_two_timeouts(whole: PublishedWalk) -> None:
    """Twice 20 ms, and a pause as long as a window; one more timeout at each later try; it is tared anew."""
    broken, seen = trial(scene_faults.StuckSda(**PASSING), whole)
    assert (seen.state, seen.cause) == (State.ABSENT, Cause.BUS_STUCK)
    assert seen.recovery_s is not None
    assert seen.recovery_s < TARED_S
    assert seen.longest_gap_s < 0.07
    assert seen.n_other_legs_lost_frames <= 18
    others = [row for row, leg in enumerate(whole.legs) if leg != FAULTY_LEG]
    # After the stall each element is read three times before its readings make a window again.
    assert (broken.state[broken.t_sent_ns > (BREAKS_AT_S + 0.12) * 1e9][:, others] == State.VALID).all()


def test_without_a_reset_pin_a_leg_that_holds_the_bus_stops_all_while_it_does(whole: PublishedWalk) -> None:
    """Nothing else disconnects it; every leg says why, and all come back when it lets go."""
    bus = msgspec.structs.replace(ROBOT.buses[0], mux=Mux())
    broken = simulate_walk(
        scene_faults.StuckSda(**PASSING), config=msgspec.structs.replace(ROBOT, buses=(bus,))
    )
    held = (broken.t_sent_ns > (BREAKS_AT_S + 0.1) * 1e9) & (broken.t_sent_ns < PASSES_AT_S * 1e9)
    assert (broken.state[held] == State.ABSENT).all()
    assert (broken.cause[held] == Cause.BUS_STUCK).all()
    assert (broken.state[-1] == State.VALID).all()
    assert fault_figures(broken, whole, BREAKS_AT_S, PASSES_AT_S).recovery_s is not None


def test_a_trunk_that_is_held_low_stops_all_and_all_come_back(whole: PublishedWalk) -> None:
    """The RESET pin is of no help there; the next try that gets through brings every leg back at once."""
    broken = simulate_walk(
        scene_faults.StuckUpstreamBus(at_s=BREAKS_AT_S, until_s=BREAKS_AT_S + 0.1), config=ROBOT
    )
    seen = fault_figures(broken, whole, BREAKS_AT_S, BREAKS_AT_S + 0.1)
    assert seen.longest_gap_s < 0.45
    assert (broken.state[-1] == State.VALID).all()


@pytest.mark.parametrize(
    "fault",
    [scene_faults.MuxReset(at_s=BREAKS_AT_S), scene_faults.ArbitrationLost(at_s=BREAKS_AT_S, rate_rel=0.02)],
    ids=lambda fault: type(fault).__name__,
)
def test_what_a_second_try_mends_is_never_seen(fault: Fault, whole: PublishedWalk) -> None:
    """A mux that forgot its channels, a transaction that another master took: no frame is lost or held up.

    What the tries take adds up to a conversion at most.
    """
    seen = trial(fault, whole)[1]
    assert (seen.state, seen.cause) == (State.VALID, Cause.NONE)
    assert seen.n_other_legs_lost_frames <= 1
    assert seen.longest_gap_s < 0.004


@pytest.mark.parametrize(
    "fault",
    [scene_faults.NackAtRandom(rate_rel=0.04, **PASSING), scene_faults.CorruptReads(rate_rel=0.2, **PASSING)],
    ids=lambda fault: type(fault).__name__,
)
def test_what_fails_now_and_then_makes_no_error_without_its_sigma(fault: Fault, whole: PublishedWalk) -> None:
    """A force that is further off than any is in a walk in which nothing fails has the sigma for it."""
    broken, seen = trial(fault, whole)
    row = whole.legs.index(FAULTY_LEG)
    error_n = np.abs(broken.force_n - broken.true_force_n)[:, row]
    far_n = 1.1 * np.nanmax(np.abs(whole.force_n - whole.true_force_n)[:, row])
    assert not (error_n > np.maximum(far_n, 5.0 * broken.sigma_n[:, row])).any()
    assert seen.detection_s is not None
    assert seen.recovery_s is not None
    assert touches_no_other_leg(broken, whole)
