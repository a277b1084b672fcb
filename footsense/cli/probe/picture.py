"""Terminal output of `footsense probe`: buses, legs, elements of every foot, diagnoses, `unloaded_pf` to configure."""

import math
import textwrap
from collections.abc import Callable, Iterator, Mapping

from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from firmware_interface.chips import ad7746, adg715, fdc1004
from footsense.acquisition.probe.address_scan import AddressProbe
from footsense.acquisition.probe.foot_check import FootScans
from footsense.cli.tables import EMPTY_CELL, Column, styled, table
from footsense.daemon.probe.report import ProbedAdapter, ProbedBus, ProbedLeg, ProbeResult
from footsense.frames import ELEMENTS, ROWS, Cause, Reading, Vector
from footsense.leg_words import CAUSE_WORDS, word_of

_CHIP_NAMES = {
    fdc1004.ADDRESS: "FDC1004",
    ad7746.ADDRESS: "AD7746",
    adg715.ADDRESS: "ADG715",
    adg715.COLUMN_ADDRESS: "ADG715",
}
#: Width of one element's text, and space between two feet beside each other [characters].
_ELEMENT_WIDTH = 7
_FOOT_SPACING_CELLS = 3


def probe_picture(result: ProbeResult, title: str) -> Group:
    """Return the whole output of a probe for a terminal of 80 columns."""
    parts: list[RenderableType] = [Text.assemble(("footsense probe  ", "bold"), title), Text()]
    for report in result.buses:
        parts += [*_bus_lines(report), Text()]
    parts += [_legs_overview(result.legs), Text()]
    scanned = [report for report in result.legs if report.scans is not None]
    if scanned:
        parts += [
            Text("every foot from above, forwards up: pF of each element", "dim"),
            Columns(
                [_foot_marks(report) for report in scanned],
                width=_ELEMENT_WIDTH * ROWS + _FOOT_SPACING_CELLS,
            ),
        ]
    if (bound_ns := result.scan_period_bound_ns) is not None:
        parts.append(
            Text(
                f"Shortest scan {bound_ns * 1e-6:.1f} ms, {bound_ns / result.scan_conversion_time_ns:.2f} x its "
                f"conversions: at most {1e9 / bound_ns:.1f} frames/s."
            )
        )
    if known := [leg.timing.keeps_done_bit for leg in result.legs if leg.timing]:
        order = (
            "while the next conversion runs"
            if all(known)
            else "before the next conversion, which makes one forget"
        )
        parts.append(Text(f"Converters are asked whether they are done {order}."))
    parts.append(Text())
    if not result.diagnoses:
        parts.append(Text("No faults.", "green"))
    else:
        parts.append(Text(f"{len(result.diagnoses)} wrong:", "bold red"))
    for location, observation, advice in result.diagnoses:
        parts.append(Padding(Text.assemble((location, "bold"), f": {observation}"), (0, 0, 0, 2)))
        parts.append(Padding(Text(f"check {advice}", "dim"), (0, 0, 0, 6)))
    if yaml := unloaded_yaml(result):
        parts += [Text(), Text("For the configuration, if these feet hang free:", "dim"), Text(yaml)]
    return Group(*parts)


def adapters_picture(reports: list[ProbedAdapter]) -> Group:
    """Return, for a terminal, the addresses that answer on each adapter of an unconfigured computer."""
    parts: list[RenderableType] = []
    for report in reports:
        parts.append(Text(report.device, "bold"))
        if report.addresses is None:
            parts.append(Text(f"  {report.error}", "bold red"))
        else:
            parts += [
                Text(f"  {line}") for line in _address_lines(report.addresses, report.kernel_drivers, {})
            ]
    parts += [
        Text(),
        Text("Feet are behind a mux (TCA9548A, 0x70 to 0x77): name it and the legs with --config FILE."),
    ]
    return Group(*parts)


def unloaded_yaml(result: ProbeResult) -> str:
    """Return the readings of all fault-free feet as YAML for `unloaded_pf`; empty without any."""
    readings = [(report.leg, report.unloaded_pf) for report in result.legs]
    lines = [f"  {leg}: [{', '.join(f'{pf:.3f}' for pf in values)}]" for leg, values in readings if values]
    folded = [textwrap.fill(line, 79, subsequent_indent=" " * 7) for line in lines]
    return "\n".join(["unloaded_pf:", *folded]) if folded else ""


def element_marks(report: ProbedLeg) -> list[tuple[str, bool]]:
    """Return for each element of a scanned foot its text, and whether it is faulty."""
    assert report.scans is not None
    marks = [
        (f"{pf:.3f}" if math.isfinite(pf) else word_of(Reading(code)), bool(code))
        for pf, code in zip(report.scans.mean_pf.tolist(), report.scans.worst_reading.tolist(), strict=True)
    ]
    for fault in report.faults:
        for element in fault.elements:
            marks[element] = (CAUSE_WORDS[fault.cause].mark or marks[element][0], True)
            if fault.cause is Cause.ELEMENT_SHORTED:
                for other in set(range(element % ROWS, ELEMENTS, ROWS)) - set(fault.elements):
                    marks[other] = ("lost", True)
    return marks


def _bus_lines(report: ProbedBus) -> Iterator[Text]:
    """Yield the text lines about one bus: chips found, addresses, timing."""
    bus, scan, drivers = report
    device = (bus.device, "bold")
    if scan.bus_timing is None:
        yield Text.assemble(device, f"   {bus.rate_hz / 1e3:.0f} kHz configured, could not be timed")
    else:
        (rate_hz, host_cost_ns), limits = scan.bus_timing.costs, scan.bus_timing.lower_bounds
        yield Text.assemble(
            device, f"   {rate_hz / 1e3:.0f} kHz, {host_cost_ns / 1e3:.0f} us of host per transaction"
        )
        yield Text(
            f"  limits: conversion {limits.conversion_bound_ns / 1e6:.1f} ms, read-out "
            f"{limits.readout_bound_ns / 1e6:.1f} ms "
            f"a scan; the {limits.limiting_factor} holds"
        )
    names = {device.address: device.name for device in bus.other_devices} | {bus.mux.address: "mux"}
    if scan.upstream is None:
        yield Text("  upstream: a line is held low", "bold red")
        return
    for line in _address_lines(scan.upstream, drivers, names):
        yield Text(f"  upstream: {line}")


def _address_lines(
    addresses: AddressProbe, drivers: Mapping[int, str], names: Mapping[int, str]
) -> Iterator[str]:
    """Yield text lines: answering addresses, addresses with kernel drivers, number of addresses not probed."""
    answering = [f"{address:#04x} {names.get(address, '')}".rstrip() for address in addresses.answering]
    yield ", ".join(answering) or "nobody answers"
    if drivers:
        held = ", ".join(f"{address:#04x} {driver}" for address, driver in sorted(drivers.items()))
        yield f"{held}: held by the kernel, not scanned"
    if addresses.unprobeable:
        yield f"{len(addresses.unprobeable)} addresses could not be scanned: this adapter does not support empty writes"


def _legs_overview(legs: tuple[ProbedLeg, ...]) -> Table:
    """Return a table with one row per leg: chips, capacitance, noise, result."""
    several = len({report.device for report in legs}) > 1
    columns: list[Column[ProbedLeg]] = [
        Column("leg", lambda leg: leg.leg, "<1"),
        Column("bus", lambda leg: leg.device, "<1" if several else ""),
        Column("channel", lambda leg: str(leg.channel_or_adapter), "<1", ("at",)),
        Column("answering", lambda leg: leg.chips, "<1", cell=_answering_chips_cell),
        Column(
            "mean_pf",
            lambda leg: _sound_element_range_text(leg, lambda scans: scans.mean_pf, "{0:.2f}..{1:.2f}"),
            ">1",
            ("C0 [pF]",),
        ),
        Column(
            "noise_ff",
            lambda leg: _sound_element_range_text(leg, lambda scans: scans.noise_ff, "{1:.2f}"),
            ">1",
        ),
        Column("foot", lambda leg: leg.faults, "<1", cell=_foot_result_cell),
    ]
    return table(columns, legs)


def _answering_chips_cell(leg: ProbedLeg) -> str:
    """Return a table cell with the chips of a leg that answer."""
    if leg.chips is None:
        return EMPTY_CELL
    names = _CHIP_NAMES if leg.chips.outcome is Reading.OK else {}
    answering = (names.get(address, f"{address:#04x} ?") for address in leg.chips.answering)
    return styled(", ".join(answering) or "nobody", "" if names else "bold red")


def _sound_element_range_text(leg: ProbedLeg, values: Callable[[FootScans], Vector], form: str) -> str:
    """Return the smallest and largest value of a foot's fault-free elements as text; "-" without any."""
    if leg.scans is None:
        return "-"
    sound = values(leg.scans)[[not faulty for _, faulty in element_marks(leg)]]
    return form.format(sound.min(), sound.max()) if sound.size else "-"


def _foot_result_cell(leg: ProbedLeg) -> str:
    """Return a table cell with the result of a foot's check."""
    if leg.scans is None:
        return styled("not scanned", "bold red")
    return styled("see below", "bold red") if leg.faults else styled("sound", "green")


def _foot_marks(report: ProbedLeg) -> Text:
    """Return a foot's elements in rows and columns as text, faulty ones marked."""
    cells = [
        Text(f"{mark:>{_ELEMENT_WIDTH}.{_ELEMENT_WIDTH}}", "bold red" if faulty else "")
        for mark, faulty in element_marks(report)
    ]
    lines = [Text.assemble(*cells[first : first + ROWS]) for first in range(0, ELEMENTS, ROWS)]
    return Text("\n").join([Text(report.leg, "bold"), *lines, Text()])
