"""What must hold in every cycle of a walk, whatever breaks in it; what does not is noted with time and leg.

A leg on which something is broken may be silent, and so may it for a while afterwards: the others go on. What is wrong
with a bus is allowed to cost its legs time, and what is wrong with CAN to cost frames there; how much, stands in
`allowances.py`.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface.can_frames import FORCE_ID, QUALITY_ID, decode_quality
from firmware_interface.socketcan import split_frames
from footsense.frames import USABLE, ContactFrame, Cycle, State
from footsense.sim.faults.scene_faults import CanFault, Fault
from footsense.validation.tolerances import Rules, Spans, excused_s, gap_costs_s

__all__ = ["Invariants", "Lost"]

_NS_PER_S = 1_000_000_000
_USABLE = frozenset(int(state) for state in USABLE)
#: Sigmas that an error may have.
_SIGMAS = 5.0
#: Violations that are kept; the others are counted.
_KEPT = 20

#: How long after the end of a fault on CAN frames may still be missing there: the interface is opened again, and the
#: kernel looks after its carrier once a second.
CAN_RECOVERY_S = 2.0

#: What looking for a leg that may be back costs the others' next frame [s]; much only against a single conversion.
_PROBE_COSTS_S = 1.5e-3
#: Frames on their way to the wire: a queue and three mailboxes full, each of which loses to another node's [bits].
_DRAIN_BITS = 2 * 19 * 135


class Lost(NamedTuple):
    """An invariant that did not hold.

    Attributes:
        rule: Which.
        t_s: When [s].
        leg: Where; empty for all.
        what: What was seen.
    """

    rule: str
    t_s: float
    leg: str
    what: str


class Invariants:
    """Watches a walk, as an observer of its cycles and as a listener on its CAN bus.

    Args:
        rules: What the walk is held to.
        script: What breaks in it.
        true_force_n: What every foot feels at a time.

    Attributes:
        well_again_s: When every leg has to be well again for good [s].
        lost: The first invariants that did not hold.
        n_lost: How many did not, by name.
        n_cycles: Cycles seen.
        n_checked: Usable forces of which the error was checked.
        n_beyond: Those with an error beyond 5 sigma, by axis, shape (3,).
        n_heard: Frames of `Force` that reached the other nodes.
        n_missed: Those that did not while CAN was broken.
        worst_gap_s: Longest time between two frames [s].
        n_states: How many leg frames had which state.
    """

    def __init__(
        self, rules: Rules, script: Sequence[Fault], true_force_n: Callable[[int], NDArray[np.float64]]
    ) -> None:
        self._rules = rules
        self._true_force_n = true_force_n
        spans_of = [excused_s(rules, script, leg) for leg in rules.legs]
        self._excused = [Spans(spans_s) for spans_s in spans_of]
        self.well_again_s = max((until_s for spans_s in spans_of for _, until_s in spans_s), default=0.0)
        self._can_broken_s = [
            (fault.at_s, fault.until_s + CAN_RECOVERY_S)
            for fault in script
            if isinstance(fault, CanFault) and fault.until_s is not None
        ]
        self._gap_costs_s = gap_costs_s(script, rules.period_s)
        self._good_s = [0.0] * len(rules.legs)  # when each leg last had a force, or an excuse
        self._last: tuple[int, int] | None = None  # sequence, t_sent_ns
        self._counters: dict[int, tuple[int, int]] = {}  # by node: counter, t_ns
        self._on_time_s = 1.1 * rules.period_s + _PROBE_COSTS_S
        self._longest_wait_s = 2.0 * rules.period_s + _DRAIN_BITS / rules.bitrate
        self.lost: list[Lost] = []
        self.n_lost: Counter[str] = Counter()
        self.n_cycles = self.n_checked = self.n_heard = self.n_missed = 0
        self.n_beyond = np.zeros(3, np.int64)
        self.worst_gap_s = 0.0
        self.n_states: Counter[int] = Counter()

    def observe(self, cycle: Cycle) -> None:
        """Check what was published."""
        frame, rules = cycle.forces, self._rules
        t_s = frame.t_sent_ns / _NS_PER_S
        self.n_cycles += 1
        self._check_pace(frame.sequence, frame.t_sent_ns, t_s)
        states: list[int] = frame.state.tolist()
        force_n: list[list[float]] = frame.force_n.tolist()
        sigma_n: list[list[float]] = frame.sigma_n.tolist()
        self.n_states.update(states)
        usable = [state in _USABLE for state in states]
        for leg, is_usable in enumerate(usable):
            some = any(map(math.isfinite, force_n[leg]))
            numbers = all(map(math.isfinite, force_n[leg])) and all(map(math.isfinite, sigma_n[leg]))
            if not numbers == some == is_usable:
                what = State(states[leg]).name
                self._lose("a number if and only if the state allows one", t_s, leg, what)
        for leg, t_ns in enumerate(frame.t_ns.tolist()):
            age_ns = frame.t_sent_ns - t_ns
            if usable[leg] and age_ns > rules.max_age_s * _NS_PER_S:
                self._lose("no force above its age limit", t_s, leg, f"{age_ns / 1e6:.1f} ms")
        for leg, (state, is_usable) in enumerate(zip(states, usable, strict=True)):
            if is_usable or t_s < rules.from_s or self._excused[leg].hold(t_s):
                self._good_s[leg] = t_s
            elif t_s - self._good_s[leg] > self._on_time_s + self._allowed_s(self._good_s[leg], t_s):
                self._lose("the other legs go on", t_s, leg, f"{State(state).name}, cause {frame.cause[leg]}")
        self._check_errors(frame, [leg for leg in range(len(usable)) if usable[leg]], force_n, sigma_n)

    def hear(self, t_ns: int, handed_ns: int, frame: bytes) -> None:
        """Check what reached the other nodes on CAN."""
        can_id, data = next(split_frames(frame))
        t_s = t_ns / _NS_PER_S
        kind, node = can_id & ~0x7F, can_id & 0x7F
        if kind not in {FORCE_ID, QUALITY_ID}:
            return
        wait_ns = t_ns - handed_ns
        if wait_ns > self._longest_wait_s * _NS_PER_S:
            self._lose(
                "no frame waits for two periods", t_s, node - 1, f"0x{can_id:03x} {wait_ns / 1e6:.1f} ms"
            )
        if kind == QUALITY_ID:
            self._check_age_on_wire(can_id, data, wait_ns, t_s)
            return
        self.n_heard += 1
        counter = data[1] & 0xF
        before = self._counters.get(node)
        self._counters[node] = (counter, t_ns)
        if before is None:
            return
        missed = (counter - before[0] - 1) % 15
        if missed:
            self.n_missed += missed
            if not self._can_was_broken(before[1] / _NS_PER_S, t_s):
                self._lose("every frame reaches CAN", t_s, node - 1, f"{missed} missing")

    def close(self) -> None:
        """Nothing is held."""

    def _check_pace(self, sequence: int, t_sent_ns: int, t_s: float) -> None:
        last, self._last = self._last, (sequence, t_sent_ns)
        if last is None:
            return
        if sequence != last[0] + 1:
            self._lose("no frame is left out", t_s, None, f"{last[0]}, then {sequence}")
        gap_s = (t_sent_ns - last[1]) / _NS_PER_S
        self.worst_gap_s = max(self.worst_gap_s, gap_s)
        if not 0.0 < gap_s <= self._on_time_s + self._allowed_s(t_s - gap_s, t_s):
            self._lose("frames keep coming on time", t_s, None, f"{1e3 * gap_s:.1f} ms")

    def _allowed_s(self, from_s: float, until_s: float) -> float:
        """Return by how much a frame may be late because of what is wrong with a bus [s]."""
        return sum(
            cost_s
            for begins_s, ends_s, cost_s in self._gap_costs_s
            if begins_s <= until_s and from_s <= ends_s
        )

    def _check_errors(
        self,
        frame: ContactFrame,
        usable: Sequence[int],
        force_n: list[list[float]],
        sigma_n: list[list[float]],
    ) -> None:
        """Count the errors of the legs that have a force."""
        sent_ns = frame.t_sent_ns
        as_of_ns = {leg: sent_ns if self._rules.element else int(frame.t_ns[leg]) for leg in usable}
        true_force_n = {t_ns: self._true_force_n(t_ns).tolist() for t_ns in set(as_of_ns.values())}
        self.n_checked += len(usable)
        for leg, t_ns in as_of_ns.items():
            for axis, true_n in enumerate(true_force_n[t_ns][leg]):
                if abs(force_n[leg][axis] - true_n) > _SIGMAS * sigma_n[leg][axis]:
                    self.n_beyond[axis] += 1

    def _check_age_on_wire(self, can_id: int, data: bytes, wait_ns: int, t_s: float) -> None:
        quality = decode_quality(can_id, data)
        if quality.age_ns is None or math.isnan(quality.sigma_n[0]):
            return  # no force goes with it
        age_ns = quality.age_ns + wait_ns
        if age_ns > (self._rules.max_age_s + self._longest_wait_s) * _NS_PER_S:
            self._lose("nothing old leaves the wire", t_s, quality.node - 1, f"{age_ns / 1e6:.1f} ms")

    def _can_was_broken(self, from_s: float, until_s: float) -> bool:
        return any(at_s <= until_s and from_s <= ends_s for at_s, ends_s in self._can_broken_s)

    def _lose(self, rule: str, t_s: float, leg: int | None, what: str) -> None:
        self.n_lost[rule] += 1
        if len(self.lost) < _KEPT:
            self.lost.append(Lost(rule, round(t_s, 4), "" if leg is None else self._rules.legs[leg], what))
