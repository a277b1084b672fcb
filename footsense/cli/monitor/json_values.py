"""A leg on CAN as plain values for JSON."""

import math
from typing import Any

from firmware_interface.can.codes import Flag
from footsense.cli.monitor.table import cause_text
from footsense.daemon.can_listener import LegSnapshot
from footsense.leg_phase import phase_of


def snapshot_json(snapshot: LegSnapshot) -> dict[str, Any]:
    """Return a leg as plain values; None and NaN stand for unknown values."""
    leg, force, report, n_force_frames, *_ = snapshot
    known, mask = snapshot.is_current, force.fault_mask
    return {
        "leg": leg,
        "link": force.status.name.lower(),
        "forces": n_force_frames,
        "phase": phase_of(force.state).name.lower() if known else None,
        "state": force.state.name.lower() if known else None,
        "cause": cause_text(snapshot),
        "usable": force.usable,
        "force_n": [round(value, 3) + 0.0 for value in force.force_n],
        "sigma_n": [round(value, 3) for value in force.sigma_n],
        "age_ms": None if force.age_ns is None else round(force.age_ns * 1e-6, 1),
        "contact": bool(force.flags & Flag.CONTACT) if force.usable else None,
        "simulated": bool(force.flags & Flag.SIMULATED) if known else None,
        "elements_out": [e for e in range(mask.bit_length()) if mask >> e & 1] if known else None,
        "baseline": {
            "status": None if report.baseline is None else report.baseline.name.lower(),
            "mean_ff": round(report.baseline_mean_offset_pf * 1e3, 1),
            "worst_ff": round(report.baseline_worst_offset_pf * 1e3, 1),
            "moved_s_ago": None
            if report.baseline_moved_ago_ns is None
            else round(report.baseline_moved_ago_ns * 1e-9, 1),
        },
        **_gait_ground_event_json(snapshot),
        "heartbeat": None if report.node_state is None else report.node_state.name.lower(),
        "degraded_timing": report.degraded_timing,
    }


def _gait_ground_event_json(snapshot: LegSnapshot) -> dict[str, Any]:
    """Return a leg's contact, ground and last event; None for each that is not known."""
    gait, ground, event = snapshot.report.gait, snapshot.report.ground, snapshot.event
    return {
        "gait": None
        if gait is None
        else {
            "contact": gait.contact,
            "contact_raw": gait.contact_raw,
            "probability": gait.probability,
            "load_share": gait.load_share,
            "slip": gait.slip.name.lower(),
            "all_in_air": gait.all_in_air,
        },
        "ground": None
        if ground is None
        else {
            "normal": [round(part, 3) for part in ground.normal],
            "normal_sigma_deg": round(math.degrees(ground.normal_sigma_rad), 2),
            "tangential_over_normal": ground.tangential_over_normal,
            "tangential_over_normal_sigma": ground.tangential_over_normal_sigma,
            "friction": ground.friction,
        },
        "last_event": None
        if event is None
        else {
            "kind": event.kind.name.lower(),
            "ago_ms": None if snapshot.event_ago_ns is None else round(snapshot.event_ago_ns * 1e-6, 1),
            "sigma_ms": round(event.sigma_s * 1e3, 1),
        },
    }
