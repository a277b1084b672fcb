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
_FARADS_PER_PF, _FARADS_PER_FF = 1e-12, 1e-15


class ServiceMetrics:
    """Metrics of the services that one exporter sees, one after the other.

    What is counted here begins with the exporter, and goes on over a restart of the service; what the service counts
    itself begins with the service.

    Args:
        legs: Name of the leg in each row of the frames.
    """

    def __init__(self, legs: Sequence[str]) -> None:
        self.legs = tuple(legs)
        self._registry = registry = CollectorRegistry()

        def histogram(name: str, meaning: str, bounds_s: Sequence[float], *labels: str) -> Histogram:
            return Histogram(name, meaning, labels, buckets=bounds_s, registry=registry)

        def counter(name: str, meaning: str) -> Counter:
            return Counter(name, meaning, registry=registry)

        def of_legs(
            name: str, meaning: str, label: str, codes: Iterable[IntEnum]
        ) -> list[dict[int, Counter]]:
            """Return a counter for each leg and code."""
            counts = Counter(name, meaning, ["leg", label], registry=registry)
            return [{code: counts.labels(leg, code.name.lower()) for code in codes} for leg in legs]

        self._cycles = counter("footsense_cycles_total", "Estimates: one a conversion, or one a record.")
        self._missed = counter(
            "footsense_exporter_missed_cycles_total", "Cycles overwritten before the exporter read them."
        )
        self._periods = histogram(
            "footsense_cycle_period_seconds", "Time from one estimate to the next.", _PERIOD_BUCKET_BOUNDS_S
        )
        age = "Age of a leg's newest reading at its estimate."
        ages = histogram("footsense_frame_age_seconds", age, _AGE_BUCKET_BOUNDS_S, "leg")
        self._ages = [ages.labels(leg) for leg in legs]
        self._leg_cycles = of_legs("footsense_leg_cycles_total", "Estimates by state.", "state", State)
        self._faults = of_legs("footsense_faults_total", "Transitions into a fault.", "kind", _FAULTS)
        self._tares = of_legs("footsense_tares_total", "Tares by result.", "result", Result)
        self._gait_events = of_legs("footsense_gait_events_total", "Gait events.", "kind", GaitEventKind)
        self.begin_service()

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
        for age, t_ns in zip(self._ages, forces.t_ns.tolist(), strict=True):
            if t_ns:
                age.observe((forces.t_sent_ns - t_ns) / 1e9)
        states = forces.state.tolist()
        for row, (state, before) in enumerate(zip(states, self._states, strict=True)):
            self._leg_cycles[row][state].inc()
            if state != before and state in self._faults[row]:
                self._faults[row][state].inc()
        self._states = states
        for outcome in cycle.ended_commands:
            if outcome.command.kind == CommandKind.TARE:
                self._tares[outcome.command.leg][outcome.result].inc()
        if forces.gait is not None:
            self._gait = forces.gait
            for event in forces.gait.events:
                self._gait_events[event.leg][event.kind].inc()

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
        gauge, codes, baseline = self._gauge, self._codes, forces.baseline
        phases = [phase_of(State(code)) for code in forces.state.tolist()]
        touches = (forces.flags & Flag.CONTACT > 0).astype(np.float64)
        degraded = float((forces.flags & Flag.DEGRADED_TIMING).any())
        age_s = np.where(baseline.moved_ns > 0, (forces.t_sent_ns - baseline.moved_ns) * 1e-9, math.nan)
        mean_f, worst_f = (pf * _FARADS_PER_PF for pf in (baseline.mean_pf, baseline.worst_pf))
        offset = "offset of the baseline since the last tare; NaN without one."
        yield codes("footsense_leg_state", "1 for the leg's state.", State, forces.state.tolist())
        yield codes("footsense_leg_phase", "1 for the leg's phase.", LegPhase, phases)
        force = "Ground reaction on the foot now, in its own frame; NaN without one."
        yield self._vectors("footsense_leg_force_newtons", force, forces.force_n)
        noise_f = forces.noise_ff * _FARADS_PER_FF
        yield gauge("footsense_reading_noise_farads", "Noise of a leg's readings.", noise_f)
        yield codes("footsense_leg_cause", "1 for the cause of the state.", Cause, forces.cause.tolist())
        yield gauge("footsense_leg_contact", "1 while the foot is in contact with the ground.", touches)
        probability = "Probability that the foot is on the ground; NaN without a force."
        yield gauge("footsense_leg_contact_probability", probability, forces.contact_probability)
        holds = "Probability that the foot stands still on the ground; NaN if that is not known."
        yield gauge("footsense_leg_holds_probability", holds, forces.holds)
        yield GaugeMetricFamily(
            "footsense_degraded_timing",
            "1 without the scheduling asked for, and in a simulation that lags.",
            degraded,
        )
        status = baseline.status.tolist()
        yield codes(
            "footsense_baseline_status", "1 for the status of drift tracking.", BaselineStatus, status
        )
        yield gauge("footsense_baseline_mean_offset_farads", f"Mean {offset}", mean_f)
        yield gauge("footsense_baseline_worst_offset_farads", f"Largest element's {offset}", worst_f)
        yield gauge(
            "footsense_baseline_age_seconds", "Time since the last tare or move; NaN if never.", age_s
        )

    def _gait_metrics(self, gait: GaitFrame) -> Iterator[Metric]:
        gauge, untold = self._gauge, "NaN without a load."
        yield gauge("footsense_leg_load_share", "Share of the load; NaN without a force.", gait.load_share)
        ratio = f"Tangential over normal force; {untold}"
        yield gauge("footsense_leg_tangential_over_normal", ratio, gait.tangential_over_normal)
        yield self._vectors("footsense_ground_normal", f"Unit normal of the ground; {untold}", gait.normal)
        sigma = f"Standard deviation of the ground's normal; {untold}"
        yield gauge("footsense_ground_normal_sigma_radians", sigma, gait.normal_sigma_rad)
        yield self._codes("footsense_leg_slip", "1 for whether the foot slides.", Slip, gait.slip.tolist())
        friction = "Coefficient of friction of the ground, as configured; NaN if not."
        yield GaugeMetricFamily("footsense_ground_friction_coefficient", friction, gait.friction)
        in_air = "1 while every leg is known to be without contact."
        yield GaugeMetricFamily("footsense_all_in_air", in_air, float(gait.all_in_air))

    def _gauge(self, name: str, meaning: str, values: Vector) -> Metric:
        gauge = GaugeMetricFamily(name, meaning, labels=["leg"])
        for leg, value in zip(self.legs, values.tolist(), strict=True):
            gauge.add_metric([leg], value)
        return gauge

    def _vectors(self, name: str, meaning: str, values: Vector) -> Metric:
        gauge = GaugeMetricFamily(name, meaning, labels=["leg", "axis"])
        for leg, components in zip(self.legs, values.tolist(), strict=True):
            for axis, value in zip("xyz", components, strict=True):
                gauge.add_metric([leg, axis], value)
        return gauge

    def _codes(self, name: str, meaning: str, codes: type[IntEnum], present: Sequence[int]) -> Metric:
        """Return a gauge of which one series of each leg is 1, as Prometheus enums are; the name ends in the label."""
        gauge = GaugeMetricFamily(name, meaning, labels=["leg", name.rpartition("_")[2]])
        for leg, now in zip(self.legs, present, strict=True):
            for code in codes:
                gauge.add_metric([leg, code.name.lower()], float(code == now))
        return gauge


def _status_metrics(status: ServiceStatus) -> Iterator[Metric]:
    """Yield what the service counts itself."""
    can = status.can
    passive = "Times that the controller became error passive, or nobody acknowledged."
    counts = [
        (
            "footsense_published_forces_total",
            "Forces of all legs published, on CAN or dropped.",
            can.published_cycles,
        ),
        ("footsense_can_sent_frames_total", "Frames handed to CAN.", can.sent),
        ("footsense_can_dropped_frames_total", "Frames that CAN did not take.", can.dropped),
        ("footsense_can_received_frames_total", "Command frames.", can.received_commands),
        (
            "footsense_can_rejected_frames_total",
            "Command frames that were not executed.",
            can.rejected_commands,
        ),
        ("footsense_can_received_motions_total", "Frames of a leg's motion.", can.received_motions),
        (
            "footsense_can_rejected_motions_total",
            "Frames of a leg's motion that were not taken.",
            can.rejected_motions,
        ),
        ("footsense_can_bus_errors_total", "Error frames of the CAN controller.", can.bus_errors),
        ("footsense_can_bus_off_total", "Times that the controller left the bus.", can.bus_off),
        ("footsense_can_error_passive_total", passive, can.error_passive),
        ("footsense_can_reopened_total", "Times that the interface came back.", can.reopened),
        ("footsense_recorder_lost_cycles_total", "Cycles not recorded.", status.n_lost_cycles),
        ("footsense_log_lost_lines_total", "Log lines without a reader.", status.n_lost_log_lines),
    ]
    if status.wakeup_histogram is not None:  # None in virtual time, in which nothing sleeps
        *wakeups, total = status.wakeup_histogram
        bounds = [*(f"{bound:g}" for bound in WAKEUP_LATENCY_BUCKET_BOUNDS_S), "+Inf"]
        buckets = list(zip(bounds, accumulate(wakeups), strict=True))
        latency = "Time from the deadline of a sleeping thread to its wake-up."
        yield HistogramMetricFamily("footsense_wakeup_latency_seconds", latency, buckets, total)
        overruns = (
            "Deadlines that had passed before the thread could sleep; a slow bus adds to them without loss."
        )
        missed = "Times that conversions were given up because a wake-up came too late; never made up for."
        counts += [
            ("footsense_overruns_total", overruns, status.n_overruns),
            ("footsense_missed_deadlines_total", missed, status.n_late_discards),
        ]
    for name, meaning, count in counts:
        yield CounterMetricFamily(name, meaning, count)
