"""Checks of every cycle of a simulated walk with faults; each violation is stored with time and leg.

A leg with a fault may be silent, and for the time of its recovery: the others go on. `tolerances.py` says how long, and
when a force or a contact may be wrong.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.crc8 import COUNTER_PERIOD, kind_and_node
from firmware_interface.can.force import FORCE_ID, QUALITY, QUALITY_ID
from firmware_interface.can.socketcan import unpack_frame
from firmware_interface.wire_timing import FRAMES_PER_LEG, LONGEST_FRAME_BITS
from footsense.frames import (
    USABLE,
    Cause,
    CommandKind,
    ContactFrame,
    Cycle,
    Flag,
    GaitEvent,
    GaitEventKind,
    Result,
    State,
    Vector,
)
from footsense.ports import Observer
from footsense.sim.can.controller import N_MAILBOXES
from footsense.sim.can.interface import AS_DEPLOYED
from footsense.sim.faults.scene_faults import CanFault, Fault, Schedule
from footsense.validation.disturbance_table import WANTED_SIGMAS, WANTED_WITHIN_REL
from footsense.validation.tolerances import (
    WalkLimits,
    broken_spans_s,
    end_s,
    tolerated_gaps_s,
    tolerated_spans_s,
    wrong_contact_spans_s,
    wrong_force_spans_s,
)

_NS_PER_S = 1_000_000_000
#: Name of each leg by its node id.
_LEG_OF_NODE = {node: leg for leg, node in NODE_IDS.items()}
_USABLE = frozenset(int(state) for state in USABLE)
#: States of a foot whose load is beyond its range, as in a landing.
_OVERLOAD_STATES = frozenset({int(State.SATURATED), int(State.OUT_OF_RANGE)})
#: Time between two frames over the fault table's longest [1]: clocks of other draws.
_ON_TIME_REL = 1.1
#: Sigmas beyond which an error is wrong, where it is also larger than the fault table's, and the time for which it may
#: be [scans]: the network sees three readings of each element, and a touch is over when all have been read.
_MOST_SIGMAS, _MOST_WRONG_SCANS = 3.0, 3.0
#: Time for which contact may be wrong [s]: of a load from this share of the largest on, and of a foot in the air.
_WRONG_CONTACT_S, _CARRIES_REL = 0.05, 0.1
_FORCE_RULE = "no force is wrong for long"
_CARRIES_RULE, _FREE_RULE = "a foot that carries is in contact", "a foot in the air is not in contact"
#: Events that say that a foot touches the ground, and the time before and after for which the ground was away from one
#: that is known to be free [scans]: the network rings after a load, and an event is dated to a scan.
_CONTACT_EVENTS = frozenset({GaitEventKind.TOUCHDOWN, GaitEventKind.SLIP})
_FREE_BEFORE_SCANS, _FREE_AFTER_SCANS = 4.0, 1.25
#: Time until the answer to a command, at most [s]: three windows of a tare and what they wait for, of an FDC1004.
LONGEST_ANSWER_S = 1.0
#: Growth of memory within the variation of the allocator [MiB].
_MAX_GROWTH_MIB = 2.0
#: Violations that are kept; the others are counted.
_MAX_KEPT_VIOLATIONS = 20
#: Time after a fault of CAN in which frames may still be lost [s]: the longest recovery of `docs/report/faults.md`.
CAN_RECOVERY_S = 0.116
#: Frames ahead of one on the wire: a full queue and the mailboxes, each of which loses to another node's [bits].
_QUEUE_DRAIN_BITS = 2 * (AS_DEPLOYED.queue_frames + N_MAILBOXES) * LONGEST_FRAME_BITS
#: Resolution of an age on CAN [ns], rounded up.
_AGE_STEP_NS = 100_000
#: Cycles whose stamps are kept for the frames on the wire.
_MAX_KEPT_CYCLES = 200


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
        violations: The first violations.
        n_violations: Number of violations by invariant.
        n_cycles: Cycles checked.
        n_checked: Usable forces of which the error was checked.
        n_within: Components of them with an error within two sigma.
        n_received: Frames of `Force` that reached the other nodes.
        n_missed: Frames of `Force` that were lost while CAN was broken.
        longest_gap_s: Longest time between two cycles [s].
        n_states: Number of cycles of a leg by state.
    """

    def __init__(
        self,
        rules: WalkLimits,
        script: Sequence[Fault],
        true_force_n_at: Callable[[int], Vector],
    ) -> None:
        self._rules, self._true_force_n_at = rules, true_force_n_at
        self._carries_n = _CARRIES_REL * rules.largest_n

        def schedules(
            spans_s: Callable[[WalkLimits, Sequence[Fault], str], list[tuple[float, float]]],
        ) -> list[Schedule[bool]]:
            return [Schedule((span_s, True) for span_s in spans_s(rules, script, leg)) for leg in rules.legs]

        self._tolerated, self._broken = schedules(tolerated_spans_s), schedules(broken_spans_s)
        self._wrong_force, self._wrong_contact = (
            schedules(wrong_force_spans_s),
            schedules(wrong_contact_spans_s),
        )
        self._gaps_s = tolerated_gaps_s(rules, script)
        self._can_broken_s = [
            (fault.at_s, end_s(fault) + CAN_RECOVERY_S) for fault in script if isinstance(fault, CanFault)
        ]
        n_legs = len(rules.legs)
        self._good_s = [0.0] * n_legs  # last time of each leg with a force, or in a tolerated span
        self._since_s: dict[tuple[str, int], float] = {}  # since when something of a leg is wrong
        self._stopped: set[int] = set()
        self._stamps_ns = [0] * n_legs
        self._sent_ns: dict[int, dict[int, int]] = {}  # newest readings by time of sending, by node
        self._last: tuple[int, int] | None = None  # sequence, t_sent_ns
        self._counters: dict[int, tuple[int, int]] = {}  # by node: counter, t_ns
        self._on_time_s = _ON_TIME_REL * rules.worst.frame_s
        # A full queue holds so many forces: two of six legs, three of three legs.
        n_forces = math.ceil(AS_DEPLOYED.queue_frames / (FRAMES_PER_LEG * n_legs))
        force_period_s = rules.cycles_per_can_force * rules.cycle_period_s
        self._longest_wait_s = n_forces * force_period_s + _QUEUE_DRAIN_BITS * rules.bit_s
        self.violations: list[Violation] = []
        self.n_violations: Counter[str] = Counter()
        self.n_cycles = self.n_checked = self.n_within = self.n_received = self.n_missed = 0
        self.longest_gap_s = 0.0
        self.n_states: Counter[int] = Counter()

    def observe(self, cycle: Cycle) -> None:
        """Check the states, values, stamps, ages, contacts and errors of a cycle's forces."""
        frame = cycle.forces
        t_s = frame.t_sent_ns / _NS_PER_S
        self.n_cycles += 1
        self._check_period(frame.sequence, frame.t_sent_ns, t_s)
        for outcome in cycle.ended_commands:
            self._take_outcome(*outcome.command, outcome.result)
        stamps_ns: list[int] = frame.t_ns.tolist()
        states: list[int] = frame.state.tolist()
        self.n_states.update(states)
        usable = [state in _USABLE for state in states]
        for leg, state in enumerate(states):
            self._check_state(frame, leg, state, t_s)
            self._check_stamp(frame.t_sent_ns, leg, stamps_ns[leg], is_usable=usable[leg])
        self._stamps_ns = stamps_ns
        self._keep_stamps(frame.t_sent_ns, stamps_ns)
        self._check_truth(frame, usable, t_s)
        if frame.gait is not None:
            self._check_events(frame.gait.events, frame.t_sent_ns)

    def _check_state(self, frame: ContactFrame, leg: int, state: int, t_s: float) -> None:
        """Check that a leg has a force where it should, and nowhere else."""
        name, is_usable = self._rules.legs[leg], state in _USABLE
        force_n, sigma_n = frame.force_n[leg].tolist(), frame.sigma_n[leg].tolist()
        numbers = all(map(math.isfinite, (*force_n, *sigma_n)))
        if not numbers == any(map(math.isfinite, force_n)) == is_usable:
            self._add_violation("a number if and only if the state allows one", t_s, name, State(state).name)
        if is_usable and leg in self._stopped:
            self._add_violation("a stopped leg has no force", t_s, name, State(state).name)
        if state == State.VALID and self._broken[leg].at(t_s):
            self._add_violation("no broken foot is Valid", t_s, name, "")
        overloaded = state in _OVERLOAD_STATES and frame.cause[leg] == Cause.OVERLOAD
        if is_usable or overloaded or leg in self._stopped or self._tolerated[leg].at(t_s):
            self._good_s[leg] = t_s
        elif t_s - self._good_s[leg] > self._on_time_s + self._tolerated_gap_s(self._good_s[leg], t_s):
            self._good_s[leg] = math.inf  # noted once
            detail = f"{State(state).name}, cause {Cause(frame.cause[leg]).name}"
            self._add_violation("no force is missing without cause", t_s, name, detail)

    def _check_stamp(self, sent_ns: int, leg: int, t_ns: int, *, is_usable: bool) -> None:
        """Check age and order of the stamp of a leg's newest reading."""
        name, age_ns = self._rules.legs[leg], sent_ns - t_ns
        if is_usable and age_ns > self._rules.max_age_s * _NS_PER_S:
            detail = f"{age_ns / 1e6:.1f} ms"
            self._add_violation("no force above its age limit", sent_ns / _NS_PER_S, name, detail)
        if t_ns and not self._stamps_ns[leg] <= t_ns <= sent_ns:
            before_ms = (self._stamps_ns[leg] - t_ns) / 1e6
            detail = f"{before_ms:.3f} ms before the last, age {age_ns / 1e6:.3f} ms"
            self._add_violation("stamps go forward, up to now", sent_ns / _NS_PER_S, name, detail)

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
            self._check_age_on_wire(can_id, data, queued_ns, t_s)
            return
        self.n_received += 1
        counter = data[1] & 0xF
        before, self._counters[node] = self._counters.get(node), (counter, t_ns)
        missed = (counter - before[0] - 1) % COUNTER_PERIOD if before is not None else 0
        self.n_missed += missed
        if before is not None and missed and not self._had_can_fault(before[1] / _NS_PER_S, t_s):
            self._add_violation("every frame reaches CAN", t_s, _LEG_OF_NODE[node], f"{missed} missing")

    def end(
        self, t_s: float, *, unanswered: Sequence[tuple[str, int]], ring_problem: str, grown_mib: float
    ) -> None:
        """Check what a walk leaves at its end.

        Args:
            t_s: Its end [s].
            unanswered: Leg and time of sending [ns] of each command that had no answer in its time.
            ring_problem: What is wrong with the ring; empty for nothing.
            grown_mib: Growth of memory after the first quarter of the walk [MiB].
        """
        for leg, sent_ns in unanswered:
            sent_s = sent_ns / _NS_PER_S
            if not self._had_can_fault(sent_s, sent_s + LONGEST_ANSWER_S):
                self._add_violation("every command has an answer", sent_s, leg, "")
        if ring_problem:
            self._add_violation("the ring has the last second", t_s, "", ring_problem)
        if grown_mib > _MAX_GROWTH_MIB:
            self._add_violation("memory does not grow", t_s, "", f"by {grown_mib:.1f} MiB")
        within_rel = self.n_within / max(3 * self.n_checked, 1)
        if self.n_checked and within_rel < WANTED_WITHIN_REL:
            self._add_violation("sigma covers the errors", t_s, "", f"{within_rel:.1%} within 2 sigma")

    def _take_outcome(self, kind: CommandKind, leg: int, result: Result) -> None:
        if result is Result.DONE and kind is CommandKind.STOP:
            self._stopped.add(leg)
        if result is Result.DONE and kind is CommandKind.START:
            self._stopped.discard(leg)

    def _keep_stamps(self, t_sent_ns: int, stamps_ns: Sequence[int]) -> None:
        self._sent_ns[t_sent_ns] = {
            NODE_IDS[leg]: t_ns for leg, t_ns in zip(self._rules.legs, stamps_ns, strict=True)
        }
        if len(self._sent_ns) > _MAX_KEPT_CYCLES:
            del self._sent_ns[next(iter(self._sent_ns))]

    def _check_period(self, sequence: int, t_sent_ns: int, t_s: float) -> None:
        """Check the sequence number of a frame, and the time since the one before."""
        last, self._last = self._last, (sequence, t_sent_ns)
        if last is None:
            return
        if sequence != last[0] + 1:
            self._add_violation("no frame is left out", t_s, "", f"{last[0]}, then {sequence}")
        gap_s = (t_sent_ns - last[1]) / _NS_PER_S
        self.longest_gap_s = max(self.longest_gap_s, gap_s)
        if not 0.0 < gap_s <= self._on_time_s + self._tolerated_gap_s(t_s - gap_s, t_s):
            self._add_violation("frames keep coming on time", t_s, "", f"{1e3 * gap_s:.1f} ms")

    def _tolerated_gap_s(self, from_s: float, until_s: float) -> float:
        """Return the gap that faults of the I2C between two times may make [s]."""
        return sum(
            gap_s for start_s, last_s, gap_s in self._gaps_s if start_s <= until_s and from_s <= last_s
        )

    def _check_truth(self, frame: ContactFrame, usable: Sequence[bool], t_s: float) -> None:
        """Check for how long forces and contacts are wrong; count the errors within two sigma."""
        true_n = self._true_force_n_at(frame.t_sent_ns)
        error_n = np.abs(frame.force_n - true_n)
        most_n = np.maximum(_MOST_SIGMAS * frame.sigma_n, self._rules.worst.error_n)
        beyond = np.count_nonzero(error_n > most_n, axis=1)
        within = (error_n <= 2.0 * frame.sigma_n).sum(axis=1)
        in_contact = (frame.flags & Flag.CONTACT).astype(bool)
        # A load that may be none by its sigma, as after a stance where it stays small, may be a shift of all readings.
        carried_n = np.maximum(self._carries_n, WANTED_SIGMAS * frame.sigma_n[:, 2])
        missed = (true_n[:, 2] > carried_n) & ~in_contact
        ghost = ~true_n.any(axis=1) & in_contact
        wrong_s = _MOST_WRONG_SCANS * self._rules.scan_s
        for leg, is_usable in enumerate(usable):
            is_settled = is_usable and not self._wrong_force[leg].at(t_s)
            tells_contact = is_usable and not self._wrong_contact[leg].at(t_s)
            if is_settled:
                self.n_checked += 1
                self.n_within += int(within[leg])
            for invariant, most_s, is_wrong in (
                (_FORCE_RULE, wrong_s, is_settled and beyond[leg]),
                (_CARRIES_RULE, _WRONG_CONTACT_S, tells_contact and missed[leg]),
                (_FREE_RULE, _WRONG_CONTACT_S, tells_contact and ghost[leg]),
            ):
                if self._lasts(invariant, leg, t_s, most_s, is_wrong=bool(is_wrong)):
                    detail = f"{frame.force_n[leg]} N for {true_n[leg]} N, sigma {frame.sigma_n[leg]} N"
                    self._add_violation(invariant, t_s, self._rules.legs[leg], detail)

    def _lasts(self, invariant: str, leg: int, t_s: float, most_s: float, *, is_wrong: bool) -> bool:
        """Return, once, whether something of a leg has been wrong for longer than it may be [s]."""
        key = invariant, leg
        if not is_wrong:
            self._since_s.pop(key, None)
            return False
        if t_s - self._since_s.setdefault(key, t_s) <= most_s:
            return False
        self._since_s[key] = math.inf
        return True

    def _check_events(self, events: Sequence[GaitEvent], now_ns: int) -> None:
        """Check that events are not of the future, and that a foot which touches the ground is there."""
        for kind, leg, t_ns, _ in events:
            if t_ns > now_ns:
                detail = f"{GaitEventKind(kind).name} in {(t_ns - now_ns) / 1e6:.1f} ms"
                self._add_violation(
                    "no event is of the future", now_ns / _NS_PER_S, self._rules.legs[leg], detail
                )
            before_ns, after_ns = (
                round(scans * self._rules.scan_s * _NS_PER_S)
                for scans in (_FREE_BEFORE_SCANS, _FREE_AFTER_SCANS)
            )
            around_ns = (t_ns - before_ns, t_ns, t_ns + after_ns, now_ns)
            is_free = not any(self._true_force_n_at(at_ns)[leg].any() for at_ns in around_ns)
            if kind in _CONTACT_EVENTS and is_free and not self._wrong_contact[leg].at(now_ns / _NS_PER_S):
                name = GaitEventKind(kind).name
                self._add_violation(
                    "no foot in the air touches", now_ns / _NS_PER_S, self._rules.legs[leg], name
                )

    def _check_age_on_wire(self, can_id: int, data: bytes, queued_ns: int, t_s: float) -> None:
        """Check that the age of a force on CAN is that of its cycle."""
        quality = QUALITY.decode(can_id, data)
        if quality.age_ns is None or math.isnan(quality.sigma_n[0]) or queued_ns not in self._sent_ns:
            return  # no force goes with it
        age_ns = queued_ns - self._sent_ns[queued_ns][quality.node]
        if abs(quality.age_ns - age_ns) > _AGE_STEP_NS:
            detail = f"{quality.age_ns / 1e6:.1f} ms for {age_ns / 1e6:.1f} ms"
            self._add_violation(
                "the age on CAN is that of the force", t_s, _LEG_OF_NODE[quality.node], detail
            )

    def _had_can_fault(self, from_s: float, until_s: float) -> bool:
        """Return whether a CAN fault or its recovery overlaps a span [s]."""
        return any(at_s <= until_s and from_s <= last_s for at_s, last_s in self._can_broken_s)

    def _add_violation(self, invariant: str, t_s: float, leg: str, detail: str) -> None:
        """Count a violation, and store it if it is one of the first."""
        self.n_violations[invariant] += 1
        if len(self.violations) < _MAX_KEPT_VIOLATIONS:
            self.violations.append(Violation(invariant, round(t_s, 4), leg, detail))
