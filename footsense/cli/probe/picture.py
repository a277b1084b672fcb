"""The picture of a probe: buses, legs, every foot's nine elements, what is wrong, and what to configure."""

import math
from collections.abc import Iterator

from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from firmware_interface import ad7746, adg715, fdc1004
from footsense.acquisition.probe.address_scan import Census
from footsense.daemon.probe.report import Adapter, BusReport, LegReport, Probed
from footsense.frames import Cause, Reading

__all__ = ["adapters_picture", "element_marks", "probe_picture", "unloaded_yaml"]

_CHIPS = {
    fdc1004.ADDRESS: "FDC1004",
    ad7746.ADDRESS: "AD7746",
    adg715.ADDRESS: "ADG715",
    adg715.COLUMN_ADDRESS: "ADG715",
}
_LEG_WIDTH = 24

#: What stands in the place of a capacitance, by what is wrong with the element.
_MARKS = {
    Cause.ELEMENT_OPEN: "open",
    Cause.ROW_OPEN: "open",
    Cause.COLUMN_OPEN: "open",
    Cause.ELEMENT_SHORTED: "short",
    Cause.GAP_CLOSED: "shut",
    Cause.CANNOT_EXCITE: "drive",
    Cause.NEVER_FINISHES: "busy",
    Cause.SETTINGS_LOST: "reset",
    Cause.CORRUPT: "garbled",
    Cause.DELAYED: "late",
}


def probe_picture(probed: Probed, title: str) -> Group:
    """Return all of it; it fits 80 columns."""
    parts: list[RenderableType] = [Text.assemble(("footsense probe  ", "bold"), title), Text()]
    for report in probed.buses:
        parts += [*_bus(report), Text()]
    parts += [_legs(probed.legs), Text()]
    feet = [_foot(report) for report in probed.legs if report.scans is not None]
    if feet:
        parts += [
            Text("every foot from above, forwards up: pF of each element", "dim"),
            Columns(feet, width=_LEG_WIDTH),
        ]
    if probed.scan_ns is not None:
        parts.append(
            Text(
                f"Shortest scan {probed.scan_ns * 1e-6:.1f} ms, {probed.scan_ns / probed.floor_ns:.2f} x its nine "
                f"conversions: at most {1e9 / probed.scan_ns:.1f} frames/s."
            )
        )
    parts.append(Text())
    if probed.complaints:
        parts.append(Text(f"{len(probed.complaints)} wrong:", "bold red"))
        for complaint in probed.complaints:
            parts.append(
                Padding(Text.assemble((complaint.where, "bold"), f": {complaint.what}"), (0, 0, 0, 2))
            )
            parts.append(Padding(Text(f"check {complaint.check}", "dim"), (0, 0, 0, 6)))
    else:
        parts.append(Text("Nothing is wrong.", "green"))
    yaml = unloaded_yaml(probed)
    if yaml:
        parts += [Text(), Text("For the configuration, if these feet hang free:", "dim"), Text(yaml)]
    return Group(*parts)


def adapters_picture(found: list[Adapter]) -> Group:
    """Return who answers on each adapter of a computer of which no configuration tells."""
    parts: list[RenderableType] = []
    for adapter in found:
        parts.append(Text(adapter.device, "bold"))
        if adapter.census is None:
            parts.append(Text(f"  {adapter.error}", "bold red"))
        else:
            parts += [Text(f"  {line}") for line in _census(adapter.census, adapter.claimed, {})]
    parts += [
        Text(),
        Text("Feet are behind a mux (TCA9548A, 0x70 to 0x77): name it and the legs with --config FILE."),
    ]
    return Group(*parts)


def unloaded_yaml(probed: Probed) -> str:
    """Return the readings of all sound feet as the configuration wants them; empty without any."""
    known = [(report.leg, report.unloaded_pf) for report in probed.legs]
    lines = [f"  {leg}: [{', '.join(f'{pf:.3f}' for pf in values)}]" for leg, values in known if values]
    return "\n".join(["unloaded_pf:", *lines]) if lines else ""


def element_marks(report: LegReport) -> list[tuple[str, bool]]:
    """Return what to show of each element of a foot that was scanned, and whether it is wrong, nine."""
    assert report.scans is not None
    marks = [
        (f"{pf:.3f}" if math.isfinite(pf) else Reading(code).name.lower().replace("_", " "), bool(code))
        for pf, code in zip(report.scans.mean_pf.tolist(), report.scans.worst.tolist(), strict=True)
    ]
    for found in report.found:
        for element in found.elements:
            marks[element] = (_MARKS.get(found.cause, marks[element][0]), True)
            if found.cause is Cause.ELEMENT_SHORTED:
                for other in {element % 3, element % 3 + 3, element % 3 + 6} - set(found.elements):
                    marks[other] = ("lost", True)
    return marks


def _bus(report: BusReport) -> Iterator[Text]:
    """Tell of one bus.

    Yields:
        Its lines.
    """
    bus, seen, claimed = report
    timing = seen.timing
    if timing is None:
        yield Text.assemble(
            (bus.device, "bold"), f"   {bus.rate_hz / 1e3:.0f} kHz configured, could not be timed"
        )
    else:
        rate_hz, host_cost_ns = timing.costs
        limits = timing.limits
        yield Text.assemble(
            (bus.device, "bold"),
            f"   {rate_hz / 1e3:.0f} kHz, {host_cost_ns / 1e3:.0f} us of host per transaction",
        )
        yield Text(
            f"  limits: conversion {limits.conversion_ns / 1e6:.1f} ms, read-out {limits.readout_ns / 1e6:.1f} ms "
            f"a scan; the {limits.holds} holds"
        )
    names = {device.address: device.name for device in bus.other_devices} | {bus.mux.address: "mux"}
    if seen.trunk is None:
        yield Text("  on the trunk: a line is held low", "bold red")
        return
    for line in _census(seen.trunk, claimed, names):
        yield Text(f"  on the trunk: {line}")


def _census(census: Census, claimed: object, names: dict[int, str]) -> Iterator[str]:
    """Tell who answers.

    Yields:
        One line about each kind.
    """
    answering = [
        f"{address:#04x}" + (f" {names[address]}" if address in names else "") for address in census.answering
    ]
    yield ", ".join(answering) or "nobody answers"
    if isinstance(claimed, dict) and claimed:
        held = ", ".join(f"{address:#04x} {driver}" for address, driver in sorted(claimed.items()))
        yield f"{held}: held by the kernel, not asked"
    if census.unasked:
        yield f"{len(census.unasked)} addresses could not be asked: this adapter does no empty writes"


def _legs(legs: tuple[LegReport, ...]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1))
    several = len({report.device for report in legs}) > 1
    for name in ("leg", *["bus"] * several, "at", "answering"):
        table.add_column(name, no_wrap=True)
    for name in ("C0 \\[pF]", "noise \\[fF]"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("foot")
    for report in legs:
        chips, foot = Text("-", "dim"), Text("not seen", "bold red")
        capacitance, noise = "-", "-"
        if report.place is not None:
            known = _CHIPS if report.place.outcome is Reading.OK else {}
            answering = (known.get(address, f"{address:#04x} ?") for address in report.place.answering)
            chips = Text(", ".join(answering) or "nobody", "" if known else "bold red")
        if report.scans is not None:
            sound = [element for element, (_, wrong) in enumerate(element_marks(report)) if not wrong]
            if sound:
                mean_pf, noise_ff = report.scans.mean_pf[sound], report.scans.noise_ff[sound]
                capacitance, noise = f"{mean_pf.min():.2f}..{mean_pf.max():.2f}", f"{noise_ff.max():.2f}"
            foot = Text("see below", "bold red") if report.found else Text("sound", "green")
        bus = [report.device] * several
        table.add_row(report.leg, *bus, str(report.where), chips, capacitance, noise, foot)
    return table


def _foot(report: LegReport) -> Text:
    cells = [Text(f"{mark:>7.7}", "bold red" if wrong else "") for mark, wrong in element_marks(report)]
    rows = [Text.assemble(*cells[first : first + 3]) for first in (0, 3, 6)]
    return Text("\n").join([Text(report.leg, "bold"), *rows, Text()])
