"""Checks of every cycle of a simulated walk with faults; each violation is stored with time and leg.

A leg with a fault may be silent, and for the time of its recovery: the others go on. A fault of a bus may delay its
legs, and a fault of CAN may cost frames there; the functions `tolerated_...` say by how much.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.crc8 import kind_and_node
from firmware_interface.can.force import FORCE_ID, QUALITY, QUALITY_ID
from firmware_interface.can.socketcan import unpack_frame
from firmware_interface.wire_timing import FRAMES_PER_LEG, LONGEST_FRAME_BITS
from footsense.frames import ELEMENTS, USABLE, ContactFrame, Cycle, State, Vector
from footsense.ports import Observer
from footsense.sim.can.controller import N_MAILBOXES
from footsense.sim.can.interface import AS_DEPLOYED
from footsense.sim.faults.scene_faults import (
    ArbitrationLost,
    CanFault,
    Fault,
    Schedule,
    StuckSda,
    StuckUpstreamBus,
)

#: Longest pause until a leg is tried again [s], and after it held a line of the bus [s]; duration of the try [s]; gait
#: periods until it is tared after that.
_PAUSE_S, _STUCK_PAUSE_S, _TRY_S, _TARE_PERIODS = 4.0, 16.0, 1.0, 3.0
#: Delay by the timeouts of each leg that holds the bus [s]; delay by a stuck upstream bus in all [s].
_STUCK_LEG_DELAY_S, _STUCK_BUS_DELAY_S = 0.085, 0.45
#: Delay of a leg whose transaction lost the arbitration twice, in scans: this one, and two until its elements have been
#: read three times in a row again.
_MAX_ARBITRATION_DELAY_SCANS = 3.4


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


def tolerated_spans_s(rules: WalkLimits, script: Sequence[Fault], leg: str) -> list[tuple[float, float]]:
    """Return the time spans [s] in which a leg may lack a force: its faults and the recoveries from them.

    A leg without an answer is tried again after pauses that double: the last is no longer than the fault.
    """
    spans: list[tuple[float, float]] = []
    for fault in sorted(script, key=lambda fault: fault.at_s):
        if isinstance(fault, CanFault | ArbitrationLost) or getattr(fault, "leg", leg) != leg:
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
        if isinstance(fault, StuckSda | StuckUpstreamBus | ArbitrationLost):
            until_s = np.inf if fault.until_s is None else fault.until_s
            after_s, delay_s = {
                StuckSda: (recovery_s, _STUCK_LEG_DELAY_S),
                StuckUpstreamBus: (recovery_s, _STUCK_BUS_DELAY_S),
                ArbitrationLost: (arbitration_s, arbitration_s),
            }[type(fault)]
            delays.append((fault.at_s, until_s + after_s, delay_s))
    return sorted(delays, key=lambda delay: delay[1])


_NS_PER_S = 1_000_000_000
#: Name of each leg by its node id.
_LEG_OF_NODE = {node: leg for leg, node in NODE_IDS.items()}
_USABLE = frozenset(int(state) for state in USABLE)
#: Limit of an error in sigmas.
_ERROR_THRESHOLD_SIGMAS = 5.0
#: Violations that are kept; the others are counted.
_MAX_KEPT_VIOLATIONS = 20

#: Time after a fault of CAN in which frames may still be lost [s]: the interface is opened again, and the kernel checks
#: its carrier once a second.
TOLERATED_CAN_RECOVERY_S = 2.0

#: Delay of the next cycle by the search for a leg [s].
_TOLERATED_LEG_SEARCH_DELAY_S = 1.5e-3
#: Frames ahead of one on the wire: a full queue and the mailboxes, each of which loses to another node's [bits].
_QUEUE_DRAIN_BITS = 2 * (AS_DEPLOYED.queue_frames + N_MAILBOXES) * LONGEST_FRAME_BITS
#: Values of the counter in a frame of CAN.
_COUNTER_VALUES = 15


class Violation(NamedTuple):
    """One violation of an invariant: invariant, time, leg, and details.

    Attributes:
        invariant: The invariant.
        t_s: Time [s].
        leg: Name of the leg; empty for all.
        detail: Offending value.
    """

    invariant: str
    t_s: float
    leg: str
    detail: str


class InvariantChecker(Observer):
    """Observer that checks each cycle and each delivered CAN frame of a simulated walk.

    Args:
        rules: Limits of the walk.
        script: Faults of the walk.
        true_force_n_at: Returns the true force on every foot at a time [ns -> N, shape (legs, 3)].

    Attributes:
        recovered_s: Time from which every leg has to be usable for good [s].
        violations: The first violations.
        n_violations: Number of violations by invariant.
        n_cycles: Cycles checked.
        n_checked: Usable forces of which the error was checked.
        n_beyond: Those with an error beyond 5 sigma, by axis, shape (3,).
        n_received: Frames of `Force` that reached the other nodes.
        n_missed: Frames of `Force` that were lost while CAN was broken.
        longest_gap_s: Longest time between two cycles [s].
        n_states: Number of cycles of a leg by state.
    """

    def __init__(
        self, rules: WalkLimits, script: Sequence[Fault], true_force_n_at: Callable[[int], Vector]
    ) -> None:
        self._rules = rules
        self._true_force_n_at = true_force_n_at
        spans_of = [tolerated_spans_s(rules, script, leg) for leg in rules.legs]
        self._tolerated = [Schedule((span_s, span_s) for span_s in spans_s) for spans_s in spans_of]
        self.recovered_s = max((until_s for spans_s in spans_of for _, until_s in spans_s), default=0.0)
        self._can_broken_s = [
            (fault.at_s, fault.until_s + TOLERATED_CAN_RECOVERY_S)
            for fault in script
            if isinstance(fault, CanFault) and fault.until_s is not None
        ]
        self._delays_s = tolerated_delays_s(script, rules.cycle_period_s)
        self._good_s = [0.0] * len(rules.legs)  # last time of each leg with a force, or in a tolerated span
        self._last: tuple[int, int] | None = None  # sequence, t_sent_ns
        self._counters: dict[int, tuple[int, int]] = {}  # by node: counter, t_ns
        self._on_time_s = 1.1 * rules.cycle_period_s + _TOLERATED_LEG_SEARCH_DELAY_S
        # A full queue holds so many forces: two of six legs, three of three legs.
        n_forces = math.ceil(AS_DEPLOYED.queue_frames / (FRAMES_PER_LEG * len(rules.legs)))
        force_period_s = rules.cycles_per_can_force * rules.cycle_period_s
        self._longest_wait_s = n_forces * force_period_s + _QUEUE_DRAIN_BITS * rules.bit_s
        self.violations: list[Violation] = []
        self.n_violations: Counter[str] = Counter()
        self.n_cycles = self.n_checked = self.n_received = self.n_missed = 0
        self.n_beyond = np.zeros(3, np.int64)
        self.longest_gap_s = 0.0
        self.n_states: Counter[int] = Counter()

    def observe(self, cycle: Cycle) -> None:
        """Check the states, values, ages and errors of a cycle's forces."""
        frame, rules = cycle.forces, self._rules
        t_s = frame.t_sent_ns / _NS_PER_S
        self.n_cycles += 1
        self._check_period(frame.sequence, frame.t_sent_ns, t_s)
        states: list[int] = frame.state.tolist()
        force_n: list[list[float]] = frame.force_n.tolist()
        sigma_n: list[list[float]] = frame.sigma_n.tolist()
        self.n_states.update(states)
        usable = [state in _USABLE for state in states]
        for leg, (name, state, is_usable, t_ns) in enumerate(
            zip(rules.legs, states, usable, frame.t_ns.tolist(), strict=True)
        ):
            some = any(map(math.isfinite, force_n[leg]))
            numbers = all(map(math.isfinite, (*force_n[leg], *sigma_n[leg])))
            if not numbers == some == is_usable:
                self._add_violation(
                    "a number if and only if the state allows one", t_s, name, State(state).name
                )
            age_ns = frame.t_sent_ns - t_ns
            if is_usable and age_ns > rules.max_age_s * _NS_PER_S:
                self._add_violation("no force above its age limit", t_s, name, f"{age_ns / 1e6:.1f} ms")
            if is_usable or t_s < rules.checks_start_s or self._tolerated[leg].at(t_s):
                self._good_s[leg] = t_s
            elif t_s - self._good_s[leg] > self._on_time_s + self._tolerated_delay_s(self._good_s[leg], t_s):
                detail = f"{State(state).name}, cause {frame.cause[leg]}"
                self._add_violation("the other legs go on", t_s, name, detail)
        self._count_errors_beyond_5_sigma(frame, np.flatnonzero(usable).tolist())

    def on_delivered(self, t_ns: int, queued_ns: int, frame: bytes) -> None:
        """Check a CAN frame that other nodes received.

        Args:
            t_ns: Time of its end on the wire [ns].
            queued_ns: Time at which it was handed to the kernel [ns].
            frame: The frame, as in `firmware_interface.can.socketcan`.
        """
        can_id, data = unpack_frame(frame)
        t_s = t_ns / _NS_PER_S
        kind, node = kind_and_node(can_id)
        if kind not in {FORCE_ID, QUALITY_ID}:
            return
        wait_ns = t_ns - queued_ns
        if wait_ns > self._longest_wait_s * _NS_PER_S:
            detail = f"0x{can_id:03x} {wait_ns / 1e6:.1f} ms"
            self._add_violation("no frame waits longer than in a full queue", t_s, _LEG_OF_NODE[node], detail)
        if kind == QUALITY_ID:
            self._check_age_on_wire(can_id, data, wait_ns, t_s)
            return
        self.n_received += 1
        counter = data[1] & 0xF
        before, self._counters[node] = self._counters.get(node), (counter, t_ns)
        missed = (counter - before[0] - 1) % _COUNTER_VALUES if before is not None else 0
        self.n_missed += missed
        if before is not None and missed and not self._had_can_fault(before[1] / _NS_PER_S, t_s):
            self._add_violation("every frame reaches CAN", t_s, _LEG_OF_NODE[node], f"{missed} missing")

    def _check_period(self, sequence: int, t_sent_ns: int, t_s: float) -> None:
        """Check the sequence number of a frame, and the time since the one before."""
        last, self._last = self._last, (sequence, t_sent_ns)
        if last is None:
            return
        if sequence != last[0] + 1:
            self._add_violation("no frame is left out", t_s, "", f"{last[0]}, then {sequence}")
        gap_s = (t_sent_ns - last[1]) / _NS_PER_S
        self.longest_gap_s = max(self.longest_gap_s, gap_s)
        if not 0.0 < gap_s <= self._on_time_s + self._tolerated_delay_s(t_s - gap_s, t_s):
            self._add_violation("frames keep coming on time", t_s, "", f"{1e3 * gap_s:.1f} ms")

    def _tolerated_delay_s(self, from_s: float, until_s: float) -> float:
        """Return the delay of a frame tolerated because of bus faults between two times [s]."""
        return sum(
            delay_s for start_s, end_s, delay_s in self._delays_s if start_s <= until_s and from_s <= end_s
        )

    def _count_errors_beyond_5_sigma(self, frame: ContactFrame, usable: Sequence[int]) -> None:
        """Count force errors beyond 5 sigma on the legs with a usable force."""
        true_n = self._true_force_n_at(frame.t_sent_ns)
        self.n_checked += len(usable)
        for leg in usable:
            error_n = np.abs(frame.force_n[leg] - true_n[leg])
            self.n_beyond += error_n > _ERROR_THRESHOLD_SIGMAS * frame.sigma_n[leg]

    def _check_age_on_wire(self, can_id: int, data: bytes, wait_ns: int, t_s: float) -> None:
        """Check the age of a force at its arrival on CAN."""
        quality = QUALITY.decode(can_id, data)
        if quality.age_ns is None or math.isnan(quality.sigma_n[0]):
            return  # no force goes with it
        age_ns = quality.age_ns + wait_ns
        if age_ns > (self._rules.max_age_s + self._longest_wait_s) * _NS_PER_S:
            self._add_violation(
                "nothing old leaves the wire", t_s, _LEG_OF_NODE[quality.node], f"{age_ns / 1e6:.1f} ms"
            )

    def _had_can_fault(self, from_s: float, until_s: float) -> bool:
        """Return whether a CAN fault or its recovery overlaps a span [s]."""
        return any(at_s <= until_s and from_s <= end_s for at_s, end_s in self._can_broken_s)

    def _add_violation(self, invariant: str, t_s: float, leg: str, detail: str) -> None:
        """Count a violation, and store it if it is one of the first."""
        self.n_violations[invariant] += 1
        if len(self.violations) < _MAX_KEPT_VIOLATIONS:
            self.violations.append(Violation(invariant, round(t_s, 4), leg, detail))
