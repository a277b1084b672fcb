"""Checks of every cycle of a simulated walk with faults; each violation is stored with time and leg.

A leg with a fault may be silent, and for the time of its recovery: the others go on. A fault of a bus may delay its
legs, and a fault of CAN may cost frames there; `tolerances.py` says by how much, and which forces may be wrong.
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
from footsense.frames import (
    ELEMENTS,
    USABLE,
    ContactFrame,
    Cycle,
    GaitEvent,
    GaitEventKind,
    Mask,
    State,
    Vector,
)
from footsense.ports import Observer
from footsense.sim.can.controller import N_MAILBOXES
from footsense.sim.can.interface import AS_DEPLOYED
from footsense.sim.faults.scene_faults import CanFault, Fault, Schedule
from footsense.validation.tolerances import (
    MAX_UNOBSERVABLE_N,
    WalkLimits,
    tolerated_delays_s,
    tolerated_spans_s,
    tolerated_touch_spans_s,
    tolerated_wrong_spans_s,
)

_NS_PER_S = 1_000_000_000
#: Name of each leg by its node id.
_LEG_OF_NODE = {node: leg for leg, node in NODE_IDS.items()}
_USABLE = frozenset(int(state) for state in USABLE)
#: Limit of an error in sigmas, and the time for which it may be beyond [scans]: 30 ms at the full rate.
_ERROR_THRESHOLD_SIGMAS, _MAX_WRONG_SCANS = 5.0, 1.25
#: Events that say that a foot touches the ground, and the time before and after for which the ground was away from one
#: that is known to be free [scans]: the network rings after a load, and an event is dated to a scan.
_CONTACT_EVENTS = frozenset({GaitEventKind.TOUCHDOWN, GaitEventKind.SLIP})
_FREE_BEFORE_SCANS, _FREE_AFTER_SCANS = 4.0, 1.25
#: Violations that are kept; the others are counted.
_MAX_KEPT_VIOLATIONS = 20

#: Time after a fault of CAN in which frames may still be lost [s]: the interface is opened again, and the kernel checks
#: its carrier once a second.
TOLERATED_CAN_RECOVERY_S = 2.0

#: Delay of the next cycle by the search for a leg [s].
_TOLERATED_LEG_SEARCH_DELAY_S = 2.5e-3
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
        n_checked: Usable forces of which the error was checked: those of legs without what cannot be observed.
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
        self._scan_s = ELEMENTS * rules.cycle_period_s
        wrong_of = [tolerated_wrong_spans_s(rules, script, leg) for leg in rules.legs]
        self._tolerated_wrong = [Schedule((span_s, span_s) for span_s in spans_s) for spans_s in wrong_of]
        touches_of = [tolerated_touch_spans_s(rules, script, leg) for leg in rules.legs]
        self._tolerated_touch = [Schedule((span_s, span_s) for span_s in spans_s) for spans_s in touches_of]
        self._wrong_since_s: list[float | None] = [None] * len(rules.legs)
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
        self._check_errors(frame, usable, t_s)
        if frame.gait is not None:
            self._check_events(frame.gait.events, frame.t_sent_ns)

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

    def _check_errors(self, frame: ContactFrame, usable: Sequence[bool], t_s: float) -> None:
        """Count the errors of usable forces beyond 5 sigma, and check how long they last."""
        tolerated = [bool(spans.at(t_s)) for spans in self._tolerated_wrong]
        allowed_n = (
            _ERROR_THRESHOLD_SIGMAS * frame.sigma_n + MAX_UNOBSERVABLE_N * np.array(tolerated)[:, None]
        )
        beyond: Mask = np.greater(np.abs(frame.force_n - self._true_force_n_at(frame.t_sent_ns)), allowed_n)
        for leg, axes in enumerate(beyond):
            if usable[leg] and not tolerated[leg]:
                self.n_checked += 1
                self.n_beyond += axes
            since_s = self._wrong_since_s[leg]
            if not (usable[leg] and axes.any()):
                self._wrong_since_s[leg] = None
            elif since_s is None:
                self._wrong_since_s[leg] = t_s
            elif t_s - since_s > _MAX_WRONG_SCANS * self._scan_s:
                self._wrong_since_s[leg] = math.inf  # noted once
                detail = f"{frame.force_n[leg]} N, sigma {frame.sigma_n[leg]} N"
                self._add_violation("no force is wrong for long", t_s, self._rules.legs[leg], detail)

    def _check_events(self, events: Sequence[GaitEvent], now_ns: int) -> None:
        """Check that a foot which touches the ground, or slides on it, is there."""
        for kind, leg, t_ns, _ in events:
            before_ns, after_ns = (
                round(scans * self._scan_s * _NS_PER_S) for scans in (_FREE_BEFORE_SCANS, _FREE_AFTER_SCANS)
            )
            around_ns = (t_ns - before_ns, t_ns, t_ns + after_ns, now_ns)
            is_free = not any(self._true_force_n_at(at_ns)[leg].any() for at_ns in around_ns)
            if kind in _CONTACT_EVENTS and is_free and not self._tolerated_touch[leg].at(now_ns / _NS_PER_S):
                name = GaitEventKind(kind).name
                self._add_violation(
                    "no foot in the air touches", now_ns / _NS_PER_S, self._rules.legs[leg], name
                )

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
