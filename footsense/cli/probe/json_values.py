"""Result of `footsense probe` as plain values for JSON; unknown values are None or NaN."""

from collections.abc import Mapping
from typing import Any

from footsense.acquisition.probe.address_scan import AddressProbe
from footsense.daemon.probe.report import ProbedAdapter, ProbedBus, ProbedLeg, ProbeResult
from footsense.frames import Reading


def probe_json(result: ProbeResult) -> dict[str, Any]:
    """Return buses, legs, shortest scan and diagnoses as plain values."""
    scan_ns = result.scan_period_bound_ns
    return {
        "buses": [_bus_json(report) for report in result.buses],
        "legs": {report.leg: _leg_json(report) for report in result.legs},
        "scan_ms": None if scan_ns is None else round(scan_ns * 1e-6, 3),
        "scan_over_conversions": None
        if scan_ns is None
        else round(scan_ns / result.scan_conversion_time_ns, 3),
        "frames_hz": None if scan_ns is None else round(1e9 / scan_ns, 2),
        "diagnoses": [diagnosis._asdict() for diagnosis in result.diagnoses],
    }


def adapters_json(reports: list[ProbedAdapter]) -> dict[str, Any]:
    """Return the addresses that answer on each I2C adapter as plain values."""
    return {
        "adapters": [
            {
                "device": report.device,
                **_address_scan_json(report.addresses, "answering"),
                "kernel_drivers": _drivers_json(report.kernel_drivers),
                "error": report.error or None,
            }
            for report in reports
        ]
    }


def _bus_json(report: ProbedBus) -> dict[str, Any]:
    """Return the result of one bus as plain values."""
    bus, scan, drivers = report
    values: dict[str, Any] = {
        "device": bus.device,
        "mux": None if bus.adapters else {"address": f"{bus.mux.address:#04x}", "answers": scan.mux_answers},
        **_address_scan_json(scan.upstream, "upstream"),
        "kernel_drivers": _drivers_json(drivers),
        "channels": {
            str(number): _addresses_json(chips.answering) for number, chips in scan.channels.items()
        },
        "configured_rate_hz": bus.rate_hz,
    }
    timing = scan.bus_timing
    if timing is None:
        names = ("rate_hz", "host_cost_us", "conversion_limit_ms", "readout_limit_ms", "limit")
        return values | dict.fromkeys(names)
    return values | {
        "rate_hz": round(timing.costs.bus_hz),
        "host_cost_us": round(timing.costs.host_ns_per_transaction * 1e-3, 1),
        "conversion_limit_ms": round(timing.lower_bounds.conversion_bound_ns * 1e-6, 3),
        "readout_limit_ms": round(timing.lower_bounds.readout_bound_ns * 1e-6, 3),
        "limit": timing.lower_bounds.limiting_factor,
    }


def _leg_json(report: ProbedLeg) -> dict[str, Any]:
    """Return the result of one leg as plain values."""
    chips, scans = report.chips, report.scans
    return {
        "bus": report.device,
        "channel": report.channel_or_adapter,
        "answering": None if chips is None else _addresses_json(chips.answering),
        "chips": None if chips is None else chips.outcome.name.lower(),
        "slowness_rel": None if report.timing is None else round(report.timing.wait_factor, 3),
        "keeps_done": None if report.timing is None else report.timing.keeps_done_bit,
        "mean_pf": None if scans is None else [round(value, 4) for value in scans.mean_pf.tolist()],
        "noise_ff": None if scans is None else [round(value, 2) for value in scans.noise_ff.tolist()],
        "reading": None
        if scans is None
        else [Reading(code).name.lower() for code in scans.worst_reading.tolist()],
        "faults": [
            {"cause": fault.cause.name.lower(), "elements": list(fault.elements)} for fault in report.faults
        ],
        "unloaded_pf": report.unloaded_pf,
    }


def _address_scan_json(scan: AddressProbe | None, name: str) -> dict[str, list[str] | None]:
    """Return the answering addresses, under `name`, and those not scanned, as text; None if unknown."""
    return {
        name: None if scan is None else _addresses_json(scan.answering),
        "not_scanned": None if scan is None else _addresses_json(scan.unprobeable),
    }


def _addresses_json(addresses: tuple[int, ...]) -> list[str]:
    """Return I2C addresses as hexadecimal text."""
    return [f"{address:#04x}" for address in addresses]


def _drivers_json(drivers: Mapping[int, str]) -> dict[str, str]:
    """Return kernel drivers by hexadecimal address."""
    return {f"{address:#04x}": name for address, name in sorted(drivers.items())}
