"""The service's metrics, each declared and counted here, from the cycles that the exporter reads."""

import math
from collections.abc import Iterable, Iterator, Sequence
from enum import IntEnum
from itertools import accumulate

import numpy as np
from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric

from footsense.frames import (
    FAULT_FREE,
    BaselineStatus,
    Cause,
    CommandKind,
    ContactFrame,
    Cycle,
    Flag,
    GaitEventKind,
    GaitFrame,
    Result,
    Slip,
    State,
    Vector,
)
from footsense.leg_words import LegPhase, phase_of
from footsense.ports import WAKEUP_LATENCY_BUCKET_BOUNDS_S
from footsense.ring.records import ServiceStatus

#: Close together around one conversion of 2.5, 5, 10 and 11 ms.
_PERIOD_BUCKET_BOUNDS_S = (
    *(0.002, 0.0025, 0.0026, 0.0027, 0.0028, 0.003, 0.004, 0.005, 0.0055, 0.006, 0.01, 0.0105, 0.011, 0.0115),
    *(0.012, 0.015, 0.02, 0.03, 0.05, 0.1, 0.12, 0.15, 0.5),
)
_AGE_BUCKET_BOUNDS_S = (
    *(0.001, 0.002, 0.003, 0.0035, 0.004, 0.005, 0.006, 0.008),
    *(0.01, 0.012, 0.015, 0.02, 0.03, 0.05, 0.1, 0.2, 0.5),
)
_FAULTS = [state for state in State if state not in FAULT_FREE]
_FARADS_PER_PF = 1e-12


class ServiceMetrics:
    """Metrics of the services that one exporter sees, one after the other.

    What is counted here begins with the exporter, and goes on over a restart of the service; what the service counts
    itself begins with the service.

    Args:
        legs: Name of the leg in each row of the frames.
    """

    def __init__(self, legs: Sequence[str]) -> None:
        self.legs = tuple(legs)
        self._registry = CollectorRegistry()
        self._cycles = self._counter(
            "footsense_cycles_total",
            "Forces estimated: one a conversion, or one a record of a microcontroller.",
        )
        self._missed = self._counter(
            "footsense_exporter_missed_cycles_total",
            "Cycles that were overwritten before the exporter read them.",
        )
        self._periods = Histogram(
            "footsense_cycle_period_seconds",
            "Time from one estimate of the forces to the next.",
            buckets=_PERIOD_BUCKET_BOUNDS_S,
            registry=self._registry,
        )
        self._ages = Histogram(
            "footsense_frame_age_seconds",
            "Age of a leg's newest reading at its estimate.",
            ["leg"],
            buckets=_AGE_BUCKET_BOUNDS_S,
            registry=self._registry,
        )
        self._leg_cycles = self._counter(
            "footsense_leg_cycles_total", "Estimates by the leg's state.", "state", State
        )
        self._faults = self._counter(
            "footsense_faults_total", "Transitions of a leg into a fault.", "kind", _FAULTS
        )
        self._tares = self._counter("footsense_tares_total", "Tares by result.", "result", Result)
        self._gait_events = self._counter(
            "footsense_gait_events_total", "Gait events by kind.", "kind", GaitEventKind
        )
        self.begin_service()

    def _counter(
        self, name: str, meaning: str, label: str | None = None, codes: Iterable[IntEnum] = ()
    ) -> Counter:
        """Return a counter; with a label, at 0 for each leg and code."""
        counter = Counter(name, meaning, ["leg", label] if label else [], registry=self._registry)
        for code in codes:
            for leg in self.legs:
                counter.labels(leg, code.name.lower())
        return counter

    def begin_service(self) -> None:
        """Begin with another service, which has another clock and states of its own."""
        self._forces: ContactFrame | None = None
        self._gait: GaitFrame | None = None
        self._states = [-1] * len(self.legs)
        self.status: ServiceStatus | None = None

    def add_missed(self, n_cycles: int) -> None:
        """Count cycles that were overwritten before they were read."""
        self._missed.inc(n_cycles)
        self._forces = None  # no period over the gap

    def add(self, cycle: Cycle) -> None:
        """Count one cycle."""
        forces = cycle.forces
        self._cycles.inc()
        if self._forces is not None:
            self._periods.observe((forces.t_sent_ns - self._forces.t_sent_ns) / 1e9)
        self._forces = forces
        for leg, t_ns in zip(self.legs, forces.t_ns.tolist(), strict=True):
            if t_ns:
                self._ages.labels(leg).observe((forces.t_sent_ns - t_ns) / 1e9)
        states = forces.state.tolist()
        for leg, code, before in zip(self.legs, states, self._states, strict=True):
            state = State(code)
            self._leg_cycles.labels(leg, state.name.lower()).inc()
            if code != before and state in _FAULTS:
                self._faults.labels(leg, state.name.lower()).inc()
        self._states = states
        for outcome in cycle.ended_commands:
            if outcome.command.kind == CommandKind.TARE:
                self._tares.labels(self.legs[outcome.command.leg], Result(outcome.result).name.lower()).inc()
        if forces.gait is not None:
            self._gait = forces.gait
            for event in forces.gait.events:
                self._gait_events.labels(self.legs[event.leg], GaitEventKind(event.kind).name.lower()).inc()

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics.

        Yields:
            One metric of each name.
        """
        yield from self._registry.collect()
        if self._forces is not None:
            yield from self._forces_metrics(self._forces)
        if self._gait is not None:
            yield from self._gait_metrics(self._gait)
        if self.status is not None:
            yield from _status_metrics(self.status)

    def _forces_metrics(self, forces: ContactFrame) -> Iterator[Metric]:
        state, baseline = forces.state.tolist(), forces.baseline
        phase = [phase_of(State(code)) for code in state]
        yield self._codes("footsense_leg_state", "1 for the state of the leg.", "state", State, state)
        yield self._codes("footsense_leg_phase", "1 for the phase of the leg.", "phase", LegPhase, phase)
        yield self._codes(
            "footsense_leg_cause",
            "1 for the cause of the leg's state.",
            "cause",
            Cause,
            forces.cause.tolist(),
        )
        yield self._gauge(
            "footsense_leg_contact",
            "1 while the foot is in contact with the ground.",
            (forces.flags & Flag.CONTACT > 0).astype(np.float64),
        )
        yield GaugeMetricFamily(
            "footsense_degraded_timing",
            "1 while the loop lacks the scheduling it asked for.",
            value=float((forces.flags & Flag.DEGRADED_TIMING).any()),
        )
        yield self._codes(
            "footsense_baseline_status",
            "1 for the status of the leg's baseline tracking.",
            "status",
            BaselineStatus,
            baseline.status.tolist(),
        )
        offset = "baseline offset since the last tare; NaN without a baseline."
        yield self._gauge(
            "footsense_baseline_mean_offset_farads",
            f"Mean over the elements of the {offset}",
            baseline.mean_pf * _FARADS_PER_PF,
        )
        yield self._gauge(
            "footsense_baseline_worst_offset_farads",
            f"Largest element's {offset}",
            baseline.worst_pf * _FARADS_PER_PF,
        )
        yield self._gauge(
            "footsense_baseline_age_seconds",
            "Time since the last tare or move; NaN if never.",
            np.where(baseline.moved_ns > 0, (forces.t_sent_ns - baseline.moved_ns) * 1e-9, math.nan),
        )

    def _gait_metrics(self, gait: GaitFrame) -> Iterator[Metric]:
        untold = "NaN if no load tells it."
        yield self._gauge(
            "footsense_leg_contact_probability",
            "Probability of contact; NaN without a force.",
            gait.probability,
        )
        yield self._gauge(
            "footsense_leg_load_share",
            "Share of the load that all legs carry; NaN without a force.",
            gait.load_share,
        )
        yield self._gauge(
            "footsense_leg_tangential_over_normal",
            f"Tangential over normal force; {untold}",
            gait.tangential_over_normal,
        )
        normal = GaugeMetricFamily(
            "footsense_ground_normal",
            f"Unit normal of the ground into the foot; {untold}",
            labels=["leg", "axis"],
        )
        for leg, components in zip(self.legs, gait.normal.tolist(), strict=True):
            for axis, value in zip("xyz", components, strict=True):
                normal.add_metric([leg, axis], value)
        yield normal
        yield self._gauge(
            "footsense_ground_normal_sigma_radians",
            f"Standard deviation of the ground's normal; {untold}",
            gait.normal_sigma_rad,
        )
        meaning = "1 for whether the foot slides, sticks, or that is not known."
        yield self._codes("footsense_leg_slip", meaning, "slip", Slip, gait.slip.tolist())
        yield GaugeMetricFamily(
            "footsense_ground_friction_coefficient",
            "Coefficient of friction that slips have taught; NaN until then.",
            value=gait.friction,
        )
        yield GaugeMetricFamily(
            "footsense_all_in_air",
            "1 while every leg is known to be without contact.",
            value=float(gait.all_in_air),
        )

    def _gauge(self, name: str, meaning: str, values: Vector) -> Metric:
        gauge = GaugeMetricFamily(name, meaning, labels=["leg"])
        for leg, value in zip(self.legs, values.tolist(), strict=True):
            gauge.add_metric([leg], value)
        return gauge

    def _codes(
        self, name: str, meaning: str, label: str, codes: type[IntEnum], present: Sequence[int]
    ) -> Metric:
        """Return a gauge of which one series of each leg is 1, as Prometheus enums are."""
        gauge = GaugeMetricFamily(name, meaning, labels=["leg", label])
        for leg, now in zip(self.legs, present, strict=True):
            for code in codes:
                gauge.add_metric([leg, code.name.lower()], float(code == now))
        return gauge


def _status_metrics(status: ServiceStatus) -> Iterator[Metric]:
    """Yield what the service counts itself."""
    counter, can = CounterMetricFamily, status.can
    yield counter(
        "footsense_published_forces_total",
        "Forces of all legs published, on CAN or dropped.",
        can.published_cycles,
    )
    yield counter("footsense_can_sent_frames_total", "Frames handed to CAN.", can.sent)
    yield counter(
        "footsense_can_dropped_frames_total", "Frames that CAN did not take; never sent late.", can.dropped
    )
    yield counter(
        "footsense_can_received_frames_total", "Command frames that arrived.", can.received_commands
    )
    yield counter(
        "footsense_can_rejected_frames_total", "Command frames that were not executed.", can.rejected_commands
    )
    yield counter(
        "footsense_can_bus_errors_total", "Error frames that the CAN controller reported.", can.bus_errors
    )
    yield counter("footsense_can_bus_off_total", "How often the controller has left the bus.", can.bus_off)
    yield counter(
        "footsense_can_error_passive_total",
        "How often the controller became error passive, or nobody acknowledged.",
        can.error_passive,
    )
    yield counter(
        "footsense_can_reopened_total", "How often the CAN interface went and came back.", can.reopened
    )
    yield counter(
        "footsense_can_unlogged_frames_total", "Sent frames missing from the CAN log.", can.unlogged
    )
    yield counter(
        "footsense_recorder_lost_cycles_total", "Cycles missing in the recording.", status.n_lost_cycles
    )
    yield counter(
        "footsense_log_lost_lines_total",
        "Log lines dropped because their reader was slow.",
        status.n_lost_log_lines,
    )
    if status.wakeup_histogram is None:  # virtual time, in which nothing sleeps
        return
    *counts, total = status.wakeup_histogram
    bounds = [*(f"{bound:g}" for bound in WAKEUP_LATENCY_BUCKET_BOUNDS_S), "+Inf"]
    latency = HistogramMetricFamily(
        "footsense_wakeup_latency_seconds", "Time from the deadline of a sleeping thread to its wake-up."
    )
    latency.add_metric([], list(zip(bounds, accumulate(counts), strict=True)), total)
    yield latency
    yield counter(
        "footsense_overruns_total",
        "Deadlines that had passed before the thread could sleep.",
        status.n_overruns,
    )
    yield counter(
        "footsense_missed_deadlines_total",
        "Conversions given up because a wake-up came too late; never made up for.",
        status.n_late_discards,
    )
