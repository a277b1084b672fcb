"""Command `footsense probe`: check I2C buses, chips and unloaded feet before the robot walks."""

import logging
import math
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.columns import Columns
from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from firmware_interface.chips import adg715, fdc1004
from footsense.cli.options import FILE, config_option, json_option
from footsense.cli.setup.robot_file import check_is_new, found_part, unloaded_yaml
from footsense.cli.tables import EMPTY_CELL, Column, echo_json, figures_table, json_row, styled, table
from footsense.config import DEFAULT, load_config
from footsense.daemon.setup.probe import ProbedBus, ProbedLeg, ProbeResult
from footsense.daemon.setup.probe import probe as probe_robot
from footsense.daemon.simulation import is_simulated
from footsense.frames import ELEMENTS, ROWS, Cause, Reading
from footsense.leg_words import CAUSE_WORDS, word_of
from footsense.sim.scene import load_scene

_DEFAULT_SCENE = "hanging"
_CHIP_NAMES = {fdc1004.ADDRESS: "FDC1004", adg715.ADDRESS: "ADG715"}
#: Width of one element's text, and space between two feet beside each other [characters].
_ELEMENT_WIDTH = 7
_FOOT_SPACING_CELLS = 3


@click.command()
@config_option("six simulated legs")
@click.option(
    "--scene",
    "scene_name",
    help="Simulate this scene: a name or a YAML file. Its feet should hang free, as in `hanging`.",
)
@click.option(
    "--write",
    "part",
    type=FILE,
    help="Write the legs that answer and their readings to this new file, as a robot's file has them.",
)
@json_option
def probe(config_file: Path | None, scene_name: str | None, part: Path | None, *, as_json: bool) -> None:
    """Scan the buses, measure their timing, and read every element of the free feet.

    Unknown addresses are only asked for an acknowledge, as `i2cdetect` does. Exit code 1 if there is a fault.
    """
    console = Console(highlight=False)
    config = load_config(config_file) if config_file else DEFAULT
    if part is not None:
        check_is_new(part)
    if scene_name is None and is_simulated(config):
        scene_name = _DEFAULT_SCENE
    # The diagnoses replace the scanner's own warnings about legs.
    logging.getLogger("footsense.acquisition").setLevel(logging.ERROR)
    result = probe_robot(config, load_scene(scene_name) if scene_name else None)
    if as_json:
        echo_json(probe_json(result))
    else:
        console.print(
            probe_picture(result, f"scene {scene_name}, simulated" if scene_name else str(config_file))
        )
    if part is not None:
        part.write_text(found_part(config, result), "utf-8")
        click.echo(f"wrote {part}", err=True)
    if result.diagnoses:
        sys.exit(1)


def probe_json(result: ProbeResult) -> dict[str, Any]:
    """Return buses, legs, shortest scan and diagnoses as plain values."""
    scan_ns = result.scan_period_bound_ns
    return {
        "buses": [_bus_figures(report) for report in result.buses],
        "legs": {leg.leg: json_row(_LEG_COLUMNS, leg) for leg in result.legs},
        "scan_ms": scan_ns and round(scan_ns * 1e-6, 3),
        "frames_hz": scan_ns and round(1e9 / scan_ns, 2),
        "diagnoses": [diagnosis._asdict() for diagnosis in result.diagnoses],
    }


def probe_picture(result: ProbeResult, title: str) -> Group:
    """Return the whole output of a probe for a terminal of 80 columns."""
    parts: list[RenderableType] = [Text.assemble(("footsense probe  ", "bold"), title), Text()]
    figures = probe_json(result)
    for bus in figures["buses"]:
        # The legs' table has the channels.
        n_left_out = len(bus["not_scanned"] or ())
        note = f"{n_left_out} addresses: this adapter does not support empty writes" if n_left_out else None
        parts += [figures_table(bus | {"channels": None, "not_scanned": note}), Text()]
    parts += [table(_LEG_COLUMNS, result.legs), Text()]
    if scanned := [leg for leg in result.legs if leg.scans is not None]:
        parts += [
            Text(
                "every foot from above, forwards up: pF of each element; above, least and largest of all nine",
                "dim",
            ),
            Columns([_foot_marks(leg) for leg in scanned], width=_ELEMENT_WIDTH * ROWS + _FOOT_SPACING_CELLS),
        ]
    parts += [figures_table({name: figures[name] for name in ("scan_ms", "frames_hz")}), Text()]
    parts += diagnoses_lines(result)
    if yaml := unloaded_yaml(result):
        parts += [
            Text(),
            Text("For the configuration, if these feet hang free and have no calibration:", "dim"),
            Text(yaml),
        ]
    return Group(*parts)


def diagnoses_lines(result: ProbeResult) -> list[RenderableType]:
    """Return what is wrong, and what to check, as lines for a terminal."""
    if not result.diagnoses:
        return [Text("No faults.", "green")]
    lines: list[RenderableType] = [Text(f"{len(result.diagnoses)} wrong:", "bold red")]
    for location, observation, advice in result.diagnoses:
        lines.append(Padding(Text.assemble((location, "bold"), f": {observation}"), (0, 0, 0, 2)))
        lines.append(Padding(Text(f"check {advice}", "dim"), (0, 0, 0, 6)))
    return lines


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


def _bus_figures(report: ProbedBus) -> dict[str, Any]:
    """Return the result of one bus as plain values: chips found, addresses, timing; None for what is not known."""
    bus, scan, drivers = report[:3]
    timing, has_mux = scan.bus_timing, bus.mux_address is not None
    limits = timing and timing.lower_bounds
    return {
        "device": bus.device,
        "mux": {"address": f"{bus.mux.address:#04x}", "answers": scan.mux_answers} if has_mux else None,
        "upstream": scan.upstream and _addresses(scan.upstream.answering, {bus.mux.address: "mux"}),
        "not_scanned": scan.upstream and [f"{address:#04x}" for address in scan.upstream.unprobeable],
        "kernel_drivers": _addresses(sorted(drivers), drivers),
        "channels": {
            str(number): _addresses(chips.answering, _CHIP_NAMES | dict.fromkeys(chips.ad7147, "AD7147"))
            for number, chips in scan.channels.items()
        },
        "configured_rate_hz": bus.rate_hz,
        "rate_hz": timing and round(timing.bus_hz),
        "host_cost_us": timing and round(timing.host_ns_per_transaction * 1e-3, 1),
        "conversion_limit_ms": limits and round(limits.conversion_bound_ns * 1e-6, 3),
        "readout_limit_ms": limits and round(limits.readout_bound_ns * 1e-6, 3),
        "limit": limits and limits.limiting_factor,
    }


def _addresses(addresses: Iterable[int], names: Mapping[int, str]) -> dict[str, str]:
    """Return the names of I2C addresses by their hexadecimal text; "?" for an unknown one."""
    return {f"{address:#04x}": names.get(address, "?") for address in addresses}


def _names(leg: ProbedLeg) -> dict[int, str]:
    return _CHIP_NAMES if leg.address is None else {leg.address: "AD7147"}


def _place_cell(leg: ProbedLeg) -> str:
    """Return the mux channel, or the address of a converter without one."""
    if leg.channel is None and leg.address is not None:
        return f"{leg.address:#04x}"
    return EMPTY_CELL if leg.channel is None else str(leg.channel)


def _chips_cell(leg: ProbedLeg) -> str:
    if leg.chips is None:
        return EMPTY_CELL
    names = _names(leg) if leg.chips.outcome is Reading.OK else {}
    answering = (names.get(address, f"{address:#04x} ?") for address in leg.chips.answering)
    return styled(", ".join(answering) or "nobody", "" if names else "bold red")


def _elements_cell(leg: ProbedLeg) -> str:
    """Return the smallest and largest reading of all elements, sound or not; a dash for one that gives no number."""
    if leg.scans is None or not np.isfinite(leg.scans.mean_pf).any():
        return EMPTY_CELL
    least_pf, most_pf = leg.scans.mean_pf.min(), np.nanmax(leg.scans.mean_pf)
    return f"{'-' if math.isnan(least_pf) else f'{least_pf:.2f}'}..{most_pf:.2f}"


def _noise_cell(leg: ProbedLeg) -> str:
    """Return the largest noise of the elements that work; that of the others is no noise."""
    if leg.scans is None:
        return EMPTY_CELL
    faults = tuple(fault for fault in leg.faults if not fault.foot_may_be_sound)
    sound_ff = leg.scans.noise_ff[[not faulty for _, faulty in element_marks(leg._replace(faults=faults))]]
    return f"{sound_ff.max():.2f}" if sound_ff.size else EMPTY_CELL


def _reads_cell(leg: ProbedLeg) -> str:
    """Return which registers of a result are read, as the converter was found to need it."""
    if leg.timing is None:
        return EMPTY_CELL
    return ("both" if leg.timing.reads_whole_result else "upper") + (
        "" if leg.timing.keeps_done_bit else ", first"
    )


def _foot_cell(leg: ProbedLeg) -> str:
    if leg.scans is None:
        return styled("not scanned", "bold red")
    return styled("see below", "bold red") if leg.faults else styled("sound", "green")


def _foot_marks(leg: ProbedLeg) -> Text:
    cells = [
        Text(f"{mark:>{_ELEMENT_WIDTH}.{_ELEMENT_WIDTH}}", "bold red" if faulty else "")
        for mark, faulty in element_marks(leg)
    ]
    lines = [Text.assemble(*cells[first : first + ROWS]) for first in range(0, ELEMENTS, ROWS)]
    return Text("\n").join([Text(leg.leg, "bold"), *lines, Text()])


_LEG_COLUMNS: list[Column[ProbedLeg]] = [
    Column("leg", lambda leg: leg.leg, "<1"),
    Column("bus", lambda leg: leg.device, "<1"),
    Column("channel", lambda leg: leg.channel, "<1", ("at",), cell=_place_cell),
    Column("address", lambda leg: None if leg.address is None else f"{leg.address:#04x}"),
    Column(
        "answering",
        lambda leg: leg.chips and _addresses(leg.chips.answering, _names(leg)),
        "<1",
        cell=_chips_cell,
    ),
    Column("chips", lambda leg: leg.chips and leg.chips.outcome),
    Column("slowness_rel", lambda leg: leg.timing and leg.timing.wait_factor),
    Column("keeps_done", lambda leg: leg.timing and leg.timing.keeps_done_bit),
    Column(
        "done_needs_both_reads",
        lambda leg: leg.timing and leg.timing.reads_whole_result,
        "<1",
        ("reads",),
        cell=_reads_cell,
    ),
    Column(
        "mean_pf",
        lambda leg: leg.scans and leg.scans.mean_pf.tolist(),
        ">1",
        ("all 9 [pF]",),
        cell=_elements_cell,
    ),
    Column(
        "noise_ff",
        lambda leg: leg.scans and leg.scans.noise_ff.tolist(),
        ">1",
        cell=_noise_cell,
    ),
    Column("reading", lambda leg: leg.scans and [Reading(code) for code in leg.scans.worst_reading]),
    Column(
        "faults",
        lambda leg: [{"cause": fault.cause.name.lower(), "elements": fault.elements} for fault in leg.faults],
    ),
    Column("foot", lambda leg: not leg.faults if leg.scans else None, "<1", cell=_foot_cell),
    Column("unloaded_pf", lambda leg: leg.unloaded_pf),
]
