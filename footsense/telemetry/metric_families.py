"""Every metric that the service has: its name, its labels, and what it tells."""

from collections.abc import Sequence

from firmware_interface.can_codes import EXPECTED, Cause, Phase, Result, State, ZeroStatus
from footsense.telemetry.shared_counters import Family

__all__ = ["AGE_BOUNDS_S", "FAULTS", "PERIOD_BOUNDS_S", "STATES", "families"]

#: Close together around one conversion of 2.5 ms, and around nine of 2.5 ms and of 11 ms.
PERIOD_BOUNDS_S = [
    *(0.002, 0.0025, 0.0027, 0.003, 0.004, 0.005, 0.01, 0.02, 0.0225, 0.023, 0.024, 0.026, 0.03, 0.05),
    *(0.09, 0.1, 0.11, 0.15, 0.5),
]
AGE_BOUNDS_S = [0.001, 0.002, 0.005, 0.01, 0.012, 0.014, 0.016, 0.02, 0.025, 0.03, 0.04, 0.05, 0.1, 0.2, 0.5]

STATES = [state.name.lower() for state in State]
#: States that nobody asked for.
FAULTS = [state for state in State if state not in EXPECTED]


def families(legs: tuple[str, ...], lateness_bounds_s: Sequence[float] | None) -> list[Family]:
    """Return the metrics of a robot with these legs.

    Args:
        legs: Name of the leg in each row of the frames.
        lateness_bounds_s: Bounds of the histogram of wake-ups [s]; None where nobody sleeps, in virtual time.
    """
    return [*_timing(lateness_bounds_s), *_frames(legs), *_legs(legs), *_zeros(legs), *_losses()]


def _timing(lateness_bounds_s: Sequence[float] | None) -> list[Family]:
    degraded = Family(
        "footsense_degraded_timing",
        "gauge",
        "1 while the loop runs without the scheduling that it asked for.",
    )
    if lateness_bounds_s is None:
        return [degraded]
    return [
        degraded,
        Family(
            "footsense_wakeup_lateness_seconds",
            "histogram",
            "Time from the deadline that a thread slept for to its wake-up.",
            bounds=list(lateness_bounds_s),
        ),
        Family(
            "footsense_overruns_total", "counter", "Deadlines that had passed before they were waited for."
        ),
        Family(
            "footsense_late_ticks_total",
            "counter",
            "Scans given up because a wake-up came too late for them; never made up for.",
        ),
    ]


def _frames(legs: tuple[str, ...]) -> list[Family]:
    leg = {"leg": list(legs)}
    return [
        Family("footsense_scans_total", "counter", "Scans published."),
        Family(
            "footsense_scan_period_seconds",
            "histogram",
            "Time from one published scan to the next.",
            bounds=PERIOD_BOUNDS_S,
        ),
        Family(
            "footsense_frame_age_seconds",
            "histogram",
            "Age of a leg's measurement when its force was sent.",
            leg,
            AGE_BOUNDS_S,
        ),
    ]


def _legs(legs: tuple[str, ...]) -> list[Family]:
    leg = {"leg": list(legs)}
    return [
        Family("footsense_leg_phase", "gauge", f"Phase of the leg: {_codes(Phase)}.", leg),
        Family("footsense_leg_state", "gauge", f"State of the leg: {_codes(State)}.", leg),
        Family("footsense_leg_cause", "gauge", f"What lies behind the state: {_codes(Cause)}.", leg),
        Family("footsense_leg_contact", "gauge", "1 while the foot is on the ground.", leg),
        Family("footsense_leg_scans_total", "counter", "Scans by the leg's state.", {**leg, "state": STATES}),
        Family(
            "footsense_faults_total",
            "counter",
            "Times that a leg fell into a state that is a fault, by state.",
            {**leg, "kind": [state.name.lower() for state in FAULTS]},
        ),
        Family(
            "footsense_tares_total",
            "counter",
            "Tares that came to an end, by result.",
            {**leg, "result": [result.name.lower() for result in Result]},
        ),
    ]


def _zeros(legs: tuple[str, ...]) -> list[Family]:
    leg = {"leg": list(legs)}
    moved = "how far its zero has moved since the last tare; NaN without one."
    return [
        Family("footsense_zero_status", "gauge", f"What its tracking does: {_codes(ZeroStatus)}.", leg),
        Family("footsense_zero_mean_offset_farads", "gauge", f"Mean over the elements of {moved}", leg),
        Family("footsense_zero_worst_offset_farads", "gauge", f"Of the worst element, {moved}", leg),
        Family(
            "footsense_zero_age_seconds",
            "gauge",
            "Time since the zero was moved or tared; NaN if never.",
            leg,
        ),
    ]


def _losses() -> list[Family]:
    return [
        Family("footsense_can_sent_frames_total", "counter", "Frames handed to CAN."),
        Family(
            "footsense_can_dropped_frames_total", "counter", "Frames that CAN did not take; never sent late."
        ),
        Family("footsense_can_received_frames_total", "counter", "Command frames that arrived."),
        Family("footsense_can_rejected_frames_total", "counter", "Command frames that were not obeyed."),
        Family("footsense_can_bus_errors_total", "counter", "Error frames that the CAN controller reported."),
        Family("footsense_can_bus_off_total", "counter", "How often the controller has left the bus."),
        Family(
            "footsense_can_error_passive_total",
            "counter",
            "How often it was near that, or nobody acknowledged.",
        ),
        Family("footsense_can_reopened_total", "counter", "How often the CAN interface went and came back."),
        Family("footsense_can_unlogged_frames_total", "counter", "Frames sent that the CAN log lacks."),
        Family(
            "footsense_recorder_lost_frames_total",
            "counter",
            "Scans that the recorder could not keep up with.",
        ),
        Family(
            "footsense_log_lost_lines_total", "counter", "Lines of the log that its reader was too slow for."
        ),
    ]


def _codes(codes: type[Cause | Phase | State | ZeroStatus]) -> str:
    return ", ".join(f"{code.value} {code.name.lower()}" for code in codes)
