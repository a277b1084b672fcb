"""What the service counts, and how a cycle changes it.

Counting happens in the loop and costs it some microseconds a cycle; showing is `exporter`'s, a process of its own.
Histograms and counts of scans change with every cycle. What others count, and the gauges that move all the time, are
copied ten times a second: nobody looks more often.
"""

import math
from array import array
from bisect import bisect_left
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from firmware_interface.can_codes import phase_of
from footsense.frames import CanStats, CommandKind, ContactFrame, Cycle, Flag, Result, State
from footsense.telemetry.exporter_process import start_exporter
from footsense.telemetry.metric_families import AGE_BOUNDS_S, FAULTS, PERIOD_BOUNDS_S, STATES, families
from footsense.telemetry.shared_counters import SharedCounters

__all__ = ["Metrics", "Wakeups", "start_exporter"]

_COPY_PERIOD_NS = 100_000_000
_FARADS_PER_PF = 1e-12


class Wakeups(Protocol):
    """What a clock counts of the deadlines of one thread.

    Attributes:
        bounds_s: Bounds of the histogram [s].
        lateness: Wake-ups in each bucket, those above the last bound, and the sum of their lateness [s].
        overruns: Deadlines that had passed before they were waited for.
    """

    @property
    def bounds_s(self) -> Sequence[float]: ...  # noqa: D102 - above
    @property
    def lateness(self) -> "array[float]": ...  # noqa: D102
    @property
    def overruns(self) -> int: ...  # noqa: D102


class Metrics:
    """Counts every cycle into shared memory.

    Args:
        legs: Name of the leg in each row of the frames.
        can: What the CAN channel counts.
        wakeups: What each thread's clock counts; none in virtual time, whose metrics tell nothing of it then.
        late_ticks: Returns how many scans were given up because a wake-up came too late, since start.
        recorder_lost: Returns how many scans the recorder could not keep up with, since start.
        log_lost: Returns how many lines the log has lost, since start.
        directory: Where the shared file is made; by default in memory.

    Timing:
        Some microseconds a cycle of six legs; no allocation that lasts, no lock, no system call.
    """

    def __init__(
        self,
        legs: tuple[str, ...],
        can: CanStats,
        *,
        wakeups: Sequence[Wakeups] = (),
        late_ticks: Callable[[], int] = int,
        recorder_lost: Callable[[], int] = int,
        log_lost: Callable[[], int] = int,
        directory: Path | None = None,
    ) -> None:
        bounds_s = wakeups[0].bounds_s if wakeups else None
        self._counters = SharedCounters(families(legs, bounds_s), directory)
        self._first = self._counters.first
        self._can = can
        self._wakeups = wakeups
        self._late_ticks = late_ticks
        self._recorder_lost = recorder_lost
        self._log_lost = log_lost
        self._t_sent_ns: int | None = None
        self._copy_due_ns: int | None = None
        self._seen: tuple[bytes, bytes, bytes] | None = None
        self._states = [-1] * len(legs)
        self._fault_column = {state.value: column for column, state in enumerate(FAULTS)}
        self._period = self._first["footsense_scan_period_seconds"]
        width = len(AGE_BOUNDS_S) + 2
        self._ages = [self._first["footsense_frame_age_seconds"] + row * width for row in range(len(legs))]
        self._scans: list[int] = []

    @property
    def path(self) -> Path:
        """The file that the exporter reads."""
        return self._counters.path

    def observe(self, cycle: Cycle) -> None:
        """Count one cycle."""
        cells, forces = self._counters.cells, cycle.forces
        sent_ns = forces.t_sent_ns
        if self._t_sent_ns is not None:
            period_s = (sent_ns - self._t_sent_ns) / 1e9
            cells[self._period + bisect_left(PERIOD_BOUNDS_S, period_s)] += 1
            cells[self._period + len(PERIOD_BOUNDS_S) + 1] += period_s
        self._t_sent_ns = sent_ns
        for first, t_ns in zip(self._ages, forces.t_ns.tolist(), strict=True):
            if t_ns:
                age_s = (sent_ns - t_ns) / 1e9
                cells[first + bisect_left(AGE_BOUNDS_S, age_s)] += 1
                cells[first + len(AGE_BOUNDS_S) + 1] += age_s
        seen = (forces.state.tobytes(), forces.cause.tobytes(), forces.flags.tobytes())
        if seen != self._seen:
            self._seen = seen
            self._note(forces)
        for cell in self._scans:
            cells[cell] += 1
        if self._copy_due_ns is None or sent_ns >= self._copy_due_ns:
            self._copy_due_ns = sent_ns + _COPY_PERIOD_NS
            self._copy(forces)
        for outcome in cycle.outcomes:
            if outcome.command.kind == CommandKind.TARE:
                place = outcome.command.leg * len(Result) + outcome.result
                cells[self._first["footsense_tares_total"] + place] += 1

    def close(self) -> None:
        """Remove the shared file."""
        self._counters.close()

    def _note(self, forces: ContactFrame) -> None:
        """Show states, causes and flags, of which one has changed, and choose the counters of scans to come."""
        states, flags = forces.state.tolist(), forces.flags.tolist()
        self._show("footsense_leg_state", states)
        self._show("footsense_leg_phase", [phase_of(State(state)) for state in states])
        self._show("footsense_leg_cause", forces.cause.tolist())
        self._show("footsense_leg_contact", [bool(flag & Flag.CONTACT) for flag in flags])
        self._show("footsense_degraded_timing", [any(flag & Flag.DEGRADED_TIMING for flag in flags)])
        by_state = self._first["footsense_leg_scans_total"]
        self._scans = [self._first["footsense_scans_total"]]
        self._scans += [by_state + row * len(STATES) + state for row, state in enumerate(states)]
        for row, (state, before) in enumerate(zip(states, self._states, strict=True)):
            column = self._fault_column.get(state)
            if state != before and column is not None:
                cell = self._first["footsense_faults_total"] + row * len(FAULTS) + column
                self._counters.cells[cell] += 1
        self._states = states

    def _copy(self, forces: ContactFrame) -> None:
        """Show what others count, and where the zeros stand."""
        can, zero = self._can, forces.baseline
        self._show(
            "footsense_can_sent_frames_total",
            [
                *(can.sent, can.dropped, can.received, can.rejected),
                *(can.bus_errors, can.bus_off, can.error_passive, can.reopened, can.unlogged),
            ],
        )
        self._show("footsense_recorder_lost_frames_total", [self._recorder_lost()])
        self._show("footsense_log_lost_lines_total", [self._log_lost()])
        self._show("footsense_zero_status", zero.status.tolist())
        self._show("footsense_zero_mean_offset_farads", (zero.mean_pf * _FARADS_PER_PF).tolist())
        self._show("footsense_zero_worst_offset_farads", (zero.worst_pf * _FARADS_PER_PF).tolist())
        now_ns = forces.t_sent_ns
        ages_s = [(now_ns - t_ns) * 1e-9 if t_ns > 0 else math.nan for t_ns in zero.moved_ns.tolist()]
        self._show("footsense_zero_age_seconds", ages_s)
        if self._wakeups:
            histograms = [wakeups.lateness for wakeups in self._wakeups]
            self._show(
                "footsense_wakeup_lateness_seconds", [sum(cell) for cell in zip(*histograms, strict=True)]
            )
            self._show("footsense_overruns_total", [sum(wakeups.overruns for wakeups in self._wakeups)])
            self._show("footsense_late_ticks_total", [self._late_ticks()])

    def _show(self, name: str, values: Sequence[float]) -> None:
        """Write the cells that begin with a family's first."""
        first = self._first[name]
        self._counters.cells[first : first + len(values)] = array("d", values)
