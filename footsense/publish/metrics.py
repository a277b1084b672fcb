"""What the service counts: every metric that it has, and how a cycle changes it.

Counting happens in the loop and costs it some microseconds a cycle; showing is `exporter`'s, a process of its own.
"""

from bisect import bisect_left
from collections.abc import Callable
from pathlib import Path

from footsense.frames import CommandKind, Cycle, Result, State
from footsense.publish.can_stats import CanStats
from footsense.publish.exporter_process import start_exporter
from footsense.publish.shared_counters import Family, SharedCounters

__all__ = ["Metrics", "start_exporter"]

#: Close together around 9 conversions of 2.5 ms and of 11 ms, the scans of the reference boards.
_PERIOD_BOUNDS_S = [
    0.002,
    0.005,
    0.01,
    0.02,
    0.0225,
    0.023,
    0.024,
    0.026,
    0.03,
    0.05,
    0.09,
    0.1,
    0.11,
    0.15,
    0.5,
]
_AGE_BOUNDS_S = [0.001, 0.002, 0.005, 0.01, 0.012, 0.014, 0.016, 0.02, 0.025, 0.03, 0.04, 0.05, 0.1, 0.2, 0.5]

_STATES = [state.name.lower() for state in State]
#: States that nobody asked for.
_FAULTS = [state for state in State if state not in {State.VALID, State.TARING, State.STOPPED}]


def _families(legs: tuple[str, ...]) -> list[Family]:
    """Return the metrics of a robot with these legs."""
    leg = {"leg": list(legs)}
    codes = ", ".join(f"{state.value} {state.name.lower()}" for state in State)
    return [
        Family(
            "footsense_scan_period_seconds",
            "histogram",
            "Time from one published scan to the next.",
            bounds=_PERIOD_BOUNDS_S,
        ),
        Family(
            "footsense_frame_age_seconds",
            "histogram",
            "Age of a leg's measurement when its force was sent.",
            leg,
            _AGE_BOUNDS_S,
        ),
        Family("footsense_scans_total", "counter", "Scans published."),
        Family("footsense_leg_state", "gauge", f"State of the leg: {codes}.", leg),
        Family(
            "footsense_leg_scans_total", "counter", "Scans by the leg's state.", {**leg, "state": _STATES}
        ),
        Family(
            "footsense_faults_total",
            "counter",
            "Times that a leg fell into a state that is a fault, by state.",
            {**leg, "kind": [state.name.lower() for state in _FAULTS]},
        ),
        Family("footsense_can_sent_frames_total", "counter", "Frames handed to CAN."),
        Family(
            "footsense_can_dropped_frames_total", "counter", "Frames that CAN did not take; never sent late."
        ),
        Family("footsense_can_received_frames_total", "counter", "Command frames that arrived."),
        Family("footsense_can_rejected_frames_total", "counter", "Command frames that were not obeyed."),
        Family("footsense_can_bus_errors_total", "counter", "Error frames that the CAN controller reported."),
        Family(
            "footsense_recorder_lost_frames_total",
            "counter",
            "Scans that the recorder could not keep up with.",
        ),
        Family(
            "footsense_tares_total",
            "counter",
            "Tares that came to an end, by result.",
            {**leg, "result": [result.name.lower() for result in Result]},
        ),
    ]


class Metrics:
    """Counts every cycle into shared memory.

    Args:
        legs: Name of the leg in each row of the frames.
        can: What the CAN channel counts; read once a cycle.
        recorder_lost: Returns how many scans the recorder could not keep up with, since start.
        directory: Where the shared file is made; by default in memory.

    Timing:
        Some microseconds a cycle of six legs; no allocation that lasts, no lock, no system call.
    """

    def __init__(
        self,
        legs: tuple[str, ...],
        can: CanStats,
        *,
        recorder_lost: Callable[[], int] = int,
        directory: Path | None = None,
    ) -> None:
        self._counters = SharedCounters(_families(legs), directory)
        self._can = can
        self._recorder_lost = recorder_lost
        self._t_sent_ns: int | None = None
        self._state = [-1] * len(legs)
        first = self._counters.first
        self._period = first["footsense_scan_period_seconds"]
        self._age = first["footsense_frame_age_seconds"]
        self._scans = first["footsense_scans_total"]
        self._leg_state = first["footsense_leg_state"]
        self._leg_scans = first["footsense_leg_scans_total"]
        self._faults = first["footsense_faults_total"]
        self._can_sent = first["footsense_can_sent_frames_total"]
        self._lost = first["footsense_recorder_lost_frames_total"]
        self._tares = first["footsense_tares_total"]
        self._fault_column = {state.value: column for column, state in enumerate(_FAULTS)}

    @property
    def path(self) -> Path:
        """The file that the exporter reads."""
        return self._counters.path

    def observe(self, cycle: Cycle) -> None:
        """Count one cycle."""
        cells, forces, can = self._counters.cells, cycle.forces, self._can
        sent_ns = forces.t_sent_ns
        if self._t_sent_ns is not None:
            period_s = (sent_ns - self._t_sent_ns) / 1e9
            cells[self._period + bisect_left(_PERIOD_BOUNDS_S, period_s)] += 1
            cells[self._period + len(_PERIOD_BOUNDS_S) + 1] += period_s
        self._t_sent_ns = sent_ns
        cells[self._scans] += 1

        age, leg_scans = self._age, self._leg_scans
        for row, (state, t_ns) in enumerate(zip(forces.state.tolist(), forces.t_ns.tolist(), strict=True)):
            if t_ns:
                age_s = (sent_ns - t_ns) / 1e9
                cells[age + bisect_left(_AGE_BOUNDS_S, age_s)] += 1
                cells[age + len(_AGE_BOUNDS_S) + 1] += age_s
            cells[leg_scans + state] += 1
            age += len(_AGE_BOUNDS_S) + 2
            leg_scans += len(_STATES)
            if state != self._state[row]:
                self._enter(row, state)

        first = self._can_sent
        cells[first] = can.sent
        cells[first + 1] = can.dropped
        cells[first + 2] = can.received
        cells[first + 3] = can.rejected
        cells[first + 4] = can.bus_errors
        cells[self._lost] = self._recorder_lost()

        for outcome in cycle.outcomes:
            if outcome.command.kind == CommandKind.TARE:
                cells[self._tares + outcome.command.leg * len(Result) + outcome.result] += 1

    def close(self) -> None:
        """Remove the shared file."""
        self._counters.close()

    def _enter(self, row: int, state: int) -> None:
        """Note that a leg has changed its state."""
        self._state[row] = state
        self._counters.cells[self._leg_state + row] = state
        column = self._fault_column.get(state)
        if column is not None:
            self._counters.cells[self._faults + row * len(_FAULTS) + column] += 1
