"""What a probe found, as plain values for JSON; null is what is not known."""

import math
from collections.abc import Mapping
from typing import Any

from footsense.daemon.probe.report import Adapter, BusReport, LegReport, Probed
from footsense.frames import Reading

__all__ = ["plain", "plain_adapters"]


def plain(probed: Probed) -> dict[str, Any]:
    """Return all of it."""
    scan_ns = probed.scan_ns
    return {
        "buses": [_bus(report) for report in probed.buses],
        "legs": {report.leg: _leg(report) for report in probed.legs},
        "scan_ms": None if scan_ns is None else round(scan_ns * 1e-6, 3),
        "scan_over_conversions": None if scan_ns is None else round(scan_ns / probed.floor_ns, 3),
        "frames_hz": None if scan_ns is None else round(1e9 / scan_ns, 2),
        "complaints": [complaint._asdict() for complaint in probed.complaints],
    }


def plain_adapters(found: list[Adapter]) -> dict[str, Any]:
    """Return who answers on each adapter."""
    return {
        "adapters": [
            {
                "device": adapter.device,
                "answering": None if adapter.addresses is None else _addresses(adapter.addresses.answering),
                "unasked": None if adapter.addresses is None else _addresses(adapter.addresses.unasked),
                "kernel_drivers": _drivers(adapter.claimed),
                "error": adapter.error or None,
            }
            for adapter in found
        ]
    }


def _bus(report: BusReport) -> dict[str, Any]:
    bus, seen, claimed = report
    timing = seen.timing
    return {
        "device": bus.device,
        "mux": None if bus.adapters else {"address": f"{bus.mux.address:#04x}", "answers": seen.mux_answers},
        "upstream": None if seen.upstream is None else _addresses(seen.upstream.answering),
        "unasked": None if seen.upstream is None else _addresses(seen.upstream.unasked),
        "kernel_drivers": _drivers(claimed),
        "behind": {str(number): _addresses(channel.answering) for number, channel in seen.channels.items()},
        "configured_rate_hz": bus.rate_hz,
        "rate_hz": None if timing is None else round(timing.costs.rate_hz),
        "host_cost_us": None if timing is None else round(timing.costs.host_cost_ns * 1e-3, 1),
        "conversion_limit_ms": None if timing is None else round(timing.limits.conversion_ns * 1e-6, 3),
        "readout_limit_ms": None if timing is None else round(timing.limits.readout_ns * 1e-6, 3),
        "limit": None if timing is None else timing.limits.holds,
    }


def _leg(report: LegReport) -> dict[str, Any]:
    channel, scans = report.channel, report.scans
    return {
        "bus": report.device,
        "where": report.where,
        "answering": None if channel is None else _addresses(channel.answering),
        "chips": None if channel is None else channel.outcome.name.lower(),
        "mean_pf": None if scans is None else [_number(value, 4) for value in scans.mean_pf.tolist()],
        "noise_ff": None if scans is None else [_number(value, 2) for value in scans.noise_ff.tolist()],
        "reading": None if scans is None else [Reading(code).name.lower() for code in scans.worst.tolist()],
        "found": [
            {"cause": found.cause.name.lower(), "elements": list(found.elements)} for found in report.found
        ],
        "unloaded_pf": report.unloaded_pf,
    }


def _addresses(addresses: tuple[int, ...]) -> list[str]:
    return [f"{address:#04x}" for address in addresses]


def _drivers(claimed: Mapping[int, str]) -> dict[str, str]:
    return {f"{address:#04x}": name for address, name in sorted(claimed.items())}


def _number(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None
