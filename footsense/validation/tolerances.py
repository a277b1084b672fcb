"""What is tolerated of a walk with faults, leg by leg and time by time, with its reason and its bound."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from footsense.frames import ELEMENTS
from footsense.sim.faults.scene_faults import (
    ArbitrationLost,
    CanFault,
    ChannelsShifted,
    ColumnShift,
    Disturbance,
    ElementDrifts,
    ElementStuck,
    Fault,
    FootDamage,
    GroundShift,
    Leakage,
    MetalBesideTail,
    NackAtRandom,
    RowShift,
    StuckSda,
    StuckUpstreamBus,
)

#: Longest pause until a leg is tried again [s], and after it held a line of the bus [s]; duration of the try [s]; gait
#: periods until it is tared after that.
_PAUSE_S, _STUCK_PAUSE_S, _TRY_S, _TARE_PERIODS = 4.0, 16.0, 1.0, 3.0
#: Delay by the timeouts of each leg that holds the bus [s]; delay by a stuck upstream bus in all [s].
_STUCK_LEG_DELAY_S, _STUCK_BUS_DELAY_S = 0.085, 0.45
#: Delay where the conversions of a leg are timed anew that was late, once a second at most [s].
_TIMING_DELAY_S = 0.0075
#: Delay of a leg whose transaction lost the arbitration twice, in scans: this one, and two until its elements have been
#: read three times in a row again.
_MAX_ARBITRATION_DELAY_SCANS = 3.4


#: What nine readings mistake for a load, with the reason: the force may be wrong until the baseline has followed.
#: True for what changes as long as it lasts; what steps is wrong for so long after its begin and its end alone.
UNOBSERVABLE: dict[type[Fault], bool] = {
    ElementDrifts: True,  # one gap that closes slowly, as under a load beside it
    ElementStuck: True,  # a gap that stands still under a load that rolls away: found at 40 % of the others' closures
    Leakage: True,  # columns that drift: a load that moves to one side
    ChannelsShifted: True,  # the readings of a load beside the one that is there
    GroundShift: False,  # a load along the leg, on a foot that stands
    MetalBesideTail: False,  # the same
    ColumnShift: False,  # a load to one side
    RowShift: False,  # a load ahead or behind
}
#: Error beyond 5 sigma that it may have [N]: of a foot that carries 0.9 N, with the amplitudes of `random_faults.py`.
MAX_UNOBSERVABLE_N = 0.4
#: Gait periods until a swing has shown the baseline.
_UNTIL_SWING_PERIODS = 1.5
#: Scans in which a line or an element that opens or comes back may read like a touch, before all of it has been read.
_DAMAGE_NOTICED_SCANS = 2.0


class WalkLimits(NamedTuple):
    """Limits of the checks of a walk: legs, cycle period [s], age limit [s], gait timing, bit on CAN [s].

    Attributes:
        legs: Names of the legs.
        cycle_period_s: Period of the cycles without faults, one for each conversion [s].
        max_age_s: Age limit of a force [s].
        gait_period_s: Gait period: each leg is in swing once in it [s].
        checks_start_s: Time from which every leg is tared [s].
        cycles_per_can_force: Cycles for each force on CAN.
        standstill_spans_s: Spans without any swing [s].
        bit_s: Duration of a bit on CAN [s].
    """

    legs: tuple[str, ...]
    cycle_period_s: float
    max_age_s: float
    gait_period_s: float
    checks_start_s: float
    cycles_per_can_force: int
    standstill_spans_s: tuple[tuple[float, float], ...] = ()
    bit_s: float = 2e-6


def acts_on(fault: Fault, leg: str) -> bool:
    """Return whether a fault is of a leg, or of all."""
    return leg in fault.legs if isinstance(fault, Disturbance) else getattr(fault, "leg", leg) == leg


def tolerated_spans_s(rules: WalkLimits, script: Sequence[Fault], leg: str) -> list[tuple[float, float]]:
    """Return the time spans [s] in which a leg may lack a force: its faults and the recoveries from them.

    A leg without an answer is tried again after pauses that double: the last is no longer than the fault.
    """
    spans: list[tuple[float, float]] = []
    for fault in sorted(script, key=lambda fault: fault.at_s):
        if isinstance(fault, CanFault | ArbitrationLost) or not acts_on(fault, leg):
            continue
        overlaps = bool(spans) and fault.at_s <= spans[-1][1]
        begin_s, end_s = spans.pop() if overlaps else (fault.at_s, 0.0)
        until_s = max(getattr(fault, "until_s", None) or fault.at_s, fault.at_s)
        longest_s = _STUCK_PAUSE_S if isinstance(fault, StuckSda | StuckUpstreamBus) else _PAUSE_S
        recovery_s = min(until_s - begin_s, longest_s) + _TRY_S + _TARE_PERIODS * rules.gait_period_s
        spans.append((begin_s, max(end_s, _time_after_walking_s(rules, until_s, recovery_s))))
    return spans


def _time_after_walking_s(rules: WalkLimits, t_s: float, walking_s: float) -> float:
    """Return the time [s] by which the robot has walked for `walking_s` after `t_s`, standstills excluded."""
    end_s = t_s + walking_s
    for stand_start_s, until_s in rules.standstill_spans_s:
        # A stand begins and ends with the legs in the middle of their stance.
        stood_s = until_s + 2.0 * rules.gait_period_s
        if stand_start_s < end_s and t_s < stood_s:
            end_s += stood_s - max(stand_start_s, t_s)
    return end_s


def tolerated_delays_s(script: Sequence[Fault], period_s: float) -> list[tuple[float, float, float]]:
    """Return start, end and tolerated delay of each I2C bus fault [s], ordered by end.

    Args:
        script: Faults of the walk.
        period_s: Period of the cycles without faults [s].
    """
    arbitration_s = _MAX_ARBITRATION_DELAY_SCANS * ELEMENTS * period_s
    recovery_s = _STUCK_PAUSE_S + _TRY_S
    delays = []
    for fault in script:
        if isinstance(fault, StuckSda | StuckUpstreamBus | ArbitrationLost | NackAtRandom):
            until_s = np.inf if fault.until_s is None else fault.until_s
            after_s, delay_s = {
                StuckSda: (recovery_s, _STUCK_LEG_DELAY_S),
                NackAtRandom: (recovery_s, _TIMING_DELAY_S),
                StuckUpstreamBus: (recovery_s, _STUCK_BUS_DELAY_S),
                ArbitrationLost: (arbitration_s, arbitration_s),
            }[type(fault)]
            delays.append((fault.at_s, until_s + after_s, delay_s))
    return sorted(delays, key=lambda delay: delay[1])


def tolerated_wrong_spans_s(
    rules: WalkLimits, script: Sequence[Fault], leg: str
) -> list[tuple[float, float]]:
    """Return the time spans [s] in which a leg may have a wrong force beside a sigma that is too small."""
    walking_s = _UNTIL_SWING_PERIODS * rules.gait_period_s
    spans: list[tuple[float, float]] = []
    for fault in script:
        if type(fault) in UNOBSERVABLE and acts_on(fault, leg):
            until_s = getattr(fault, "until_s", None) or np.inf
            parts = (
                [(fault.at_s, until_s)]
                if UNOBSERVABLE[type(fault)]
                else [(at_s, at_s) for at_s in (fault.at_s, until_s)]
            )
            spans += [(at_s, _time_after_walking_s(rules, end_s, walking_s)) for at_s, end_s in parts]
    return spans


def tolerated_touch_spans_s(
    rules: WalkLimits, script: Sequence[Fault], leg: str
) -> list[tuple[float, float]]:
    """Return the time spans [s] in which a leg may be said to touch the ground in the air.

    A touchdown has to be reported within a reading. What moves the readings at once, as a touchdown does, is one.
    """
    noticed_s = _DAMAGE_NOTICED_SCANS * ELEMENTS * rules.cycle_period_s
    spans = tolerated_wrong_spans_s(rules, script, leg)
    for fault in script:
        until_s = getattr(fault, "until_s", None) or np.inf
        if isinstance(fault, Disturbance) and acts_on(fault, leg):
            spans.append((fault.at_s, until_s + noticed_s))
        elif isinstance(fault, FootDamage) and acts_on(fault, leg):
            spans += [(at_s, at_s + noticed_s) for at_s in (fault.at_s, until_s)]
    return spans
