"""Declaration of every metric of the service: name, labels, help."""

from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Literal

from firmware_interface.can.codes import (
    FAULT_FREE,
    BaselineStatus,
    Cause,
    GaitEventKind,
    Result,
    Slip,
    State,
)
from footsense.leg_words import LegPhase
from footsense.telemetry.shared_counters import MetricFamily

#: Close together around one conversion of 2.5, 5, 10 and 11 ms.
CYCLE_PERIOD_BUCKET_BOUNDS_S = [
    *(0.002, 0.0025, 0.0026, 0.0027, 0.0028, 0.003, 0.004, 0.005, 0.0055, 0.006, 0.01, 0.0105, 0.011, 0.0115),
    *(0.012, 0.015, 0.02, 0.03, 0.05, 0.1, 0.12, 0.15, 0.5),
]
READING_AGE_BUCKET_BOUNDS_S = [
    *(
        0.001,
        0.002,
        0.003,
        0.0035,
        0.004,
        0.005,
        0.006,
        0.008,
        0.01,
        0.012,
        0.015,
        0.02,
        0.03,
        0.05,
        0.1,
        0.2,
        0.5,
    ),
]

#: States that are faults.
FAULT_STATES = [state for state in State if state not in FAULT_FREE]

#: Gauges of which exactly one series per leg is 1, as Prometheus enums are: label, codes, meaning.
STATE_SETS: dict[str, tuple[str, type[IntEnum], str]] = {
    "footsense_leg_state": ("state", State, "1 for the state of the leg."),
    "footsense_leg_phase": ("phase", LegPhase, "1 for the phase of the leg."),
    "footsense_leg_cause": ("cause", Cause, "1 for the cause of the leg's state."),
    "footsense_baseline_status": (
        "status",
        BaselineStatus,
        "1 for the status of the leg's baseline tracking.",
    ),
    "footsense_leg_slip": ("slip", Slip, "1 for whether the foot slides, sticks, or that is not known."),
}

#: Gauges of each leg's gait, by field of `GaitFrame`.
GAIT_GAUGES = {
    "probability": ("footsense_leg_contact_probability", "Probability of contact; NaN without a force."),
    "load_share": (
        "footsense_leg_load_share",
        "Share of the load that all legs carry; NaN without a force.",
    ),
    "tangential_over_normal": (
        "footsense_leg_tangential_over_normal",
        "Tangential over normal force; NaN if no load tells it.",
    ),
    "normal_sigma_rad": (
        "footsense_ground_normal_sigma_radians",
        "Standard deviation of the ground's normal; NaN if no load tells it.",
    ),
}
#: Axes of a vector in the frame of the force.
AXIS_NAMES = ["x", "y", "z"]

#: Counters of the CAN channel, by field of `CanStatistics`.
CAN_COUNTERS = {
    "published_cycles": (
        "footsense_published_forces_total",
        "Forces of all legs published, on CAN or dropped.",
    ),
    "sent": ("footsense_can_sent_frames_total", "Frames handed to CAN."),
    "dropped": ("footsense_can_dropped_frames_total", "Frames that CAN did not take; never sent late."),
    "received_commands": ("footsense_can_received_frames_total", "Command frames that arrived."),
    "rejected_commands": ("footsense_can_rejected_frames_total", "Command frames that were not executed."),
    "bus_errors": ("footsense_can_bus_errors_total", "Error frames that the CAN controller reported."),
    "bus_off": ("footsense_can_bus_off_total", "How often the controller has left the bus."),
    "error_passive": (
        "footsense_can_error_passive_total",
        "How often the controller became error passive, or nobody acknowledged.",
    ),
    "reopened": ("footsense_can_reopened_total", "How often the CAN interface went and came back."),
    "unlogged": ("footsense_can_unlogged_frames_total", "Sent frames missing from the CAN log."),
}


def service_metrics(legs: tuple[str, ...], wakeup_bounds_s: Sequence[float] | None) -> list[MetricFamily]:
    """Return the metric families of a robot with these legs.

    Args:
        legs: Name of the leg in each row of the frames.
        wakeup_bounds_s: Bounds of the wake-up latency's histogram [s]; None in virtual time, where nothing sleeps.
    """
    leg = {"leg": list(legs)}
    states = {**leg, "state": _code_names(State)}
    offset = "baseline offset since the last tare; NaN without a baseline."
    return [
        *(_wakeup_metrics(wakeup_bounds_s) if wakeup_bounds_s is not None else ()),
        _metric_family("footsense_degraded_timing", "1 while the loop lacks the scheduling it asked for."),
        _metric_family(
            "footsense_cycles_total",
            "Forces estimated: one a conversion, or one a record of a microcontroller.",
        ),
        _metric_family(
            "footsense_cycle_period_seconds",
            "Time from one estimate of the forces to the next.",
            {},
            CYCLE_PERIOD_BUCKET_BOUNDS_S,
        ),
        _metric_family(
            "footsense_frame_age_seconds",
            "Age of a leg's newest reading at its estimate.",
            leg,
            READING_AGE_BUCKET_BOUNDS_S,
        ),
        *(
            _metric_family(name, meaning, {**leg, label: _code_names(codes)})
            for name, (label, codes, meaning) in STATE_SETS.items()
        ),
        _metric_family("footsense_leg_contact", "1 while the foot is in contact with the ground.", leg),
        *(_metric_family(name, meaning, leg) for name, meaning in GAIT_GAUGES.values()),
        _metric_family(
            "footsense_ground_normal",
            "Unit normal of the ground into the foot; NaN if no load tells it.",
            {**leg, "axis": AXIS_NAMES},
        ),
        _metric_family(
            "footsense_ground_friction_coefficient",
            "Coefficient of friction that slips have taught; NaN until then.",
        ),
        _metric_family("footsense_all_in_air", "1 while every leg is known to be without contact."),
        _metric_family(
            "footsense_gait_events_total", "Gait events by kind.", {**leg, "kind": _code_names(GaitEventKind)}
        ),
        _metric_family("footsense_leg_cycles_total", "Estimates by the leg's state.", states),
        _metric_family(
            "footsense_faults_total",
            "Transitions of a leg into a fault.",
            {**leg, "kind": _code_names(FAULT_STATES)},
        ),
        _metric_family("footsense_tares_total", "Tares by result.", {**leg, "result": _code_names(Result)}),
        _metric_family(
            "footsense_baseline_mean_offset_farads", f"Mean over the elements of the {offset}", leg
        ),
        _metric_family("footsense_baseline_worst_offset_farads", f"Largest element's {offset}", leg),
        _metric_family(
            "footsense_baseline_age_seconds", "Time since the last tare or move; NaN if never.", leg
        ),
        *(_metric_family(name, meaning) for name, meaning in CAN_COUNTERS.values()),
        _metric_family("footsense_recorder_lost_cycles_total", "Cycles missing in the recording."),
        _metric_family("footsense_log_lost_lines_total", "Log lines dropped because their reader was slow."),
    ]


def _wakeup_metrics(bounds_s: Sequence[float]) -> list[MetricFamily]:
    """Return the metric families of the threads' wake-up latency."""
    latency = "Time from the deadline of a sleeping thread to its wake-up."
    missed = "Conversions given up because a wake-up came too late; never made up for."
    return [
        _metric_family("footsense_wakeup_latency_seconds", latency, {}, bounds_s),
        _metric_family(
            "footsense_overruns_total", "Deadlines that had passed before the thread could sleep."
        ),
        _metric_family("footsense_missed_deadlines_total", missed),
    ]


def _metric_family(
    name: str, meaning: str, labels: Mapping[str, list[str]] | None = None, bounds: Sequence[float] = ()
) -> MetricFamily:
    """Return a metric family: histogram if it has bounds, counter if its name ends in `_total`, else gauge."""
    kind: Literal["counter", "gauge", "histogram"] = "counter" if name.endswith("_total") else "gauge"
    return MetricFamily(name, "histogram" if bounds else kind, meaning, dict(labels or {}), list(bounds))


def _code_names(codes: "type[IntEnum] | list[State]") -> list[str]:
    """Return the names of enumeration members as label values."""
    return [code.name.lower() for code in codes]
