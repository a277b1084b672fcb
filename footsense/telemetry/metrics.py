"""Observer that updates the service's shared-memory counters after every cycle.

Counting happens in the loop and costs some microseconds a cycle; `footsense exporter` serves the counters. Histograms
and counts of cycles change with every cycle; the counts of others and the gauges that move all the time are copied ten
times a second.
"""

import math
from array import array
from bisect import bisect_left
from collections.abc import Callable, Sequence
from pathlib import Path

from footsense.frames import (
    CanStatistics,
    CommandKind,
    ContactFrame,
    Cycle,
    Flag,
    GaitEventKind,
    GaitFrame,
    Result,
    State,
)
from footsense.leg_words import phase_of
from footsense.ports import Observer, WakeupLatency
from footsense.telemetry.metric_families import (
    CAN_COUNTERS,
    CYCLE_PERIOD_BUCKET_BOUNDS_S,
    FAULT_STATES,
    GAIT_GAUGES,
    READING_AGE_BUCKET_BOUNDS_S,
    STATE_SETS,
    service_metrics,
)
from footsense.telemetry.shared_counters import SharedCountersWriter

_SLOW_COPY_PERIOD_NS = 100_000_000
_FARADS_PER_PF = 1e-12

# Looked up by plain numbers: an enumeration's arithmetic costs a microsecond each time.
_N_CODES_OF_STATE_SET = {name: len(codes) for name, (_, codes, _) in STATE_SETS.items()}
_PHASE_OF_STATE = {state.value: phase_of(state).value for state in State}
_CONTACT, _DEGRADED_TIMING = int(Flag.CONTACT), int(Flag.DEGRADED_TIMING)


class MetricsObserver(Observer):
    """Observer that adds every cycle to the service's counters in shared memory.

    Args:
        legs: Name of the leg in each row of the frames.
        can: Counts of the CAN channel.
        path: File of the counters, from which `footsense exporter` reads them.
        wakeups: Wake-up latency of each thread's clock; none in virtual time, and then no metrics of it.
        n_late_discards: Returns how often readings were discarded since start, as the loop or a record came too late.
        n_lost_cycles: Returns how many cycles are missing in the recording, since start.
        n_lost_log_lines: Returns how many lines the log has dropped, since start.

    Raises:
        FootsenseError: The file cannot be written, or belongs to another running service.

    Timing:
        3 us a cycle of six legs; no lasting allocation, no lock, no system call.
    """

    def __init__(
        self,
        legs: tuple[str, ...],
        can: CanStatistics,
        path: Path,
        *,
        wakeups: Sequence[WakeupLatency] = (),
        n_late_discards: Callable[[], int] = int,
        n_lost_cycles: Callable[[], int] = int,
        n_lost_log_lines: Callable[[], int] = int,
    ) -> None:
        self._counters = SharedCountersWriter(
            service_metrics(legs, wakeups[0].bounds_s if wakeups else None), path
        )
        self._first = self._counters.first_cell
        self._can = can
        self._wakeups = wakeups
        self._late_discards = n_late_discards
        self._n_lost_cycles = n_lost_cycles
        self._n_lost_log_lines = n_lost_log_lines
        self._t_sent_ns: int | None = None
        self._copy_due_ns: int | None = None
        self._last: tuple[bytes, bytes, bytes] | None = None
        self._states = [-1] * len(legs)
        self._fault_column = {state.value: column for column, state in enumerate(FAULT_STATES)}
        self._period = self._first["footsense_cycle_period_seconds"]
        cells_per_label_set = len(READING_AGE_BUCKET_BOUNDS_S) + 2
        self._ages = [
            self._first["footsense_frame_age_seconds"] + row * cells_per_label_set for row in range(len(legs))
        ]
        self._cycle_cells: list[int] = []
        self._can_cells = [(self._first[name], field) for field, (name, _) in CAN_COUNTERS.items()]
        self._state_cells: dict[str, list[int]] = {}

    def observe(self, cycle: Cycle) -> None:
        """Add one cycle to the shared counters."""
        cells, forces = self._counters.cells, cycle.forces
        sent_ns = forces.t_sent_ns
        if self._t_sent_ns is not None:
            period_s = (sent_ns - self._t_sent_ns) / 1e9
            cells[self._period + bisect_left(CYCLE_PERIOD_BUCKET_BOUNDS_S, period_s)] += 1
            cells[self._period + len(CYCLE_PERIOD_BUCKET_BOUNDS_S) + 1] += period_s
        self._t_sent_ns = sent_ns
        for first, t_ns in zip(self._ages, forces.t_ns.tolist(), strict=True):
            if t_ns:
                age_s = (sent_ns - t_ns) / 1e9
                cells[first + bisect_left(READING_AGE_BUCKET_BOUNDS_S, age_s)] += 1
                cells[first + len(READING_AGE_BUCKET_BOUNDS_S) + 1] += age_s
        present = (forces.state.tobytes(), forces.cause.tobytes(), forces.flags.tobytes())
        if present != self._last:
            self._last = present
            self._update_states(forces)
        for cell in self._cycle_cells:
            cells[cell] += 1
        if forces.gait is not None:
            self._update_gait(forces.gait)
        if self._copy_due_ns is None or sent_ns >= self._copy_due_ns:
            self._copy_due_ns = sent_ns + _SLOW_COPY_PERIOD_NS
            self._copy_slow_metrics(forces)
        for outcome in cycle.ended_commands:
            if outcome.command.kind == CommandKind.TARE:
                column = outcome.command.leg * len(Result) + outcome.result
                cells[self._first["footsense_tares_total"] + column] += 1

    def close(self) -> None:
        """Close the shared counters, and remove their file."""
        self._counters.close()

    def _update_states(self, forces: ContactFrame) -> None:
        """Update the states, causes and flags, and the choice of counters for the following cycles."""
        states, flags = forces.state.tolist(), forces.flags.tolist()
        self._set_state_set("footsense_leg_state", states)
        self._set_state_set("footsense_leg_phase", [_PHASE_OF_STATE[state] for state in states])
        self._set_state_set("footsense_leg_cause", forces.cause.tolist())
        self._set_cells("footsense_leg_contact", [bool(flag & _CONTACT) for flag in flags])
        self._set_cells("footsense_degraded_timing", [any(flag & _DEGRADED_TIMING for flag in flags)])
        by_state, n_states = self._first["footsense_leg_cycles_total"], len(State)
        self._cycle_cells = [self._first["footsense_cycles_total"]]
        self._cycle_cells += [by_state + row * n_states + state for row, state in enumerate(states)]
        for row, (state, before) in enumerate(zip(states, self._states, strict=True)):
            column = self._fault_column.get(state)
            if state != before and column is not None:
                cell = self._first["footsense_faults_total"] + row * len(FAULT_STATES) + column
                self._counters.cells[cell] += 1
        self._states = states

    def _update_gait(self, gait: GaitFrame) -> None:
        """Update the gait gauges, and count the gait events."""
        for field, (name, _) in GAIT_GAUGES.items():
            self._set_cells(name, getattr(gait, field).tolist())
        self._set_cells("footsense_ground_normal", gait.normal.ravel().tolist())
        self._set_cells("footsense_ground_friction_coefficient", [gait.friction])
        self._set_cells("footsense_all_in_air", [gait.all_in_air])
        self._set_state_set("footsense_leg_slip", gait.slip.tolist())
        first = self._first["footsense_gait_events_total"]
        for event in gait.events:
            self._counters.cells[first + event.leg * len(GaitEventKind) + event.kind - 1] += 1

    def _copy_slow_metrics(self, forces: ContactFrame) -> None:
        """Copy counts kept by other parts (CAN, clocks, log) and the baselines to the metrics."""
        baseline, cells = forces.baseline, self._counters.cells
        for cell, field in self._can_cells:
            cells[cell] = getattr(self._can, field)
        self._set_cells("footsense_recorder_lost_cycles_total", [self._n_lost_cycles()])
        self._set_cells("footsense_log_lost_lines_total", [self._n_lost_log_lines()])
        self._set_state_set("footsense_baseline_status", baseline.status.tolist())
        self._set_cells("footsense_baseline_mean_offset_farads", (baseline.mean_pf * _FARADS_PER_PF).tolist())
        self._set_cells(
            "footsense_baseline_worst_offset_farads", (baseline.worst_pf * _FARADS_PER_PF).tolist()
        )
        now_ns = forces.t_sent_ns
        ages_s = [(now_ns - t_ns) * 1e-9 if t_ns > 0 else math.nan for t_ns in baseline.moved_ns.tolist()]
        self._set_cells("footsense_baseline_age_seconds", ages_s)
        if self._wakeups:
            histograms = [wakeups.histogram for wakeups in self._wakeups]
            self._set_cells(
                "footsense_wakeup_latency_seconds", [sum(cell) for cell in zip(*histograms, strict=True)]
            )
            self._set_cells("footsense_overruns_total", [sum(wakeups.overruns for wakeups in self._wakeups)])
            self._set_cells("footsense_missed_deadlines_total", [self._late_discards()])

    def _set_state_set(self, name: str, states: Sequence[int]) -> None:
        """Set each leg's series of a state set: 1 for its present code, 0 for the previous one."""
        first, n_codes = self._first[name], _N_CODES_OF_STATE_SET[name]
        present = [first + row * n_codes + state for row, state in enumerate(states)]
        before = self._state_cells.get(name, present)
        cells = self._counters.cells
        for cell, cell_before in zip(present, before, strict=True):
            cells[cell_before] = 0.0
            cells[cell] = 1.0
        self._state_cells[name] = present

    def _set_cells(self, name: str, values: Sequence[float]) -> None:
        """Set the values of a metric family."""
        first = self._first[name]
        self._counters.cells[first : first + len(values)] = array("d", values)
