"""Fabrication package: all files of a foot in one folder."""

from pathlib import Path
from typing import NamedTuple

from footsense.errors import ConfigError
from footsense.lab.design.processes import AssumedProcess, assumed_process
from footsense.lab.fabrication import dimensions, documents
from footsense.lab.fabrication.parts import gerber, sheets, solids
from footsense.lab.fabrication.parts.flex import Board, Flex, flexes
from footsense.lab.fabrication.tolerances import (
    ExpectedCapacitance,
    expected_capacitance,
    manufacturing_problems,
    part_tolerances,
)
from footsense.lab.geometry import FootDesign


class FabricationPackage(NamedTuple):
    """Process, circuits and expected readings of one foot's fabrication files.

    Attributes:
        assumed: What its design assumed.
        flexes: The lower and the upper one.
        expected: Expected reading of each element.
    """

    assumed: AssumedProcess
    flexes: tuple[Flex, Flex]
    expected: ExpectedCapacitance


def write_fabrication_package(
    design: FootDesign, folder: Path, process: str | None = None, board: Board = "ad7147"
) -> FabricationPackage:
    """Write all fabrication files of a foot: STEP, Gerber, drill, DXF, and the documents.

    Args:
        design: The foot.
        folder: Where they are written.
        process: Name of the process that its design assumed; None for the first with its film.
        board: Electronics of the foot.

    Raises:
        ConfigError: It cannot be made, or not as exactly as its design assumed; the message begins with the key.
    """
    assumed = assumed_process(design, process)
    for problem in manufacturing_problems(design, assumed, board):
        raise ConfigError(problem)
    tolerances = part_tolerances(design, assumed.rms_deviations)
    for row in tolerances:
        if not row.is_within_assumed:
            raise ConfigError(
                f"{row.name}: +-{row.max_deviation:g} {row.unit} is wider than process {assumed.process_name} "
                f"assumes ({row.assumed_text})"
            )
    package = FabricationPackage(
        assumed, flexes(design, board), expected_capacitance(design, assumed.rms_deviations)
    )
    (folder / "step").mkdir(parents=True, exist_ok=True)
    for name, solid in solids.all_parts(design, package.flexes).items():
        solids.write_step(name, solid, folder / "step" / f"{name}.step")
    for flex in package.flexes:
        _write_flex(folder / flex.name, flex)
    shapes = {
        "spacer": (sheets.spacer_outline(design), design.gap_um),
        "film": (sheets.film_outline(design), design.film_um),
    }
    for name, (shape, thickness_um) in shapes.items():
        sheets.write_dxf(
            folder / f"{name}.dxf", shape, f"{design.foot_type} {name}, {thickness_um:g} um thick"
        )
    documents.write_documents(folder, design, board, assumed, package.flexes, tolerances, package.expected)
    return package


def _write_flex(folder: Path, flex: Flex) -> None:
    """Write Gerber layers and drill file of one flex into a folder."""
    folder.mkdir(exist_ok=True)
    layers = {
        "copper": gerber.gerber_text(gerber.COPPER, flex.name, [*flex.copper, *flex.via_pads]),
        "coverlay": gerber.gerber_text(gerber.COVERLAY, flex.name, flex.coverlay_openings),
        "profile": gerber.gerber_text(gerber.PROFILE, flex.name, flex.profile),
        "stiffener": gerber.gerber_text(gerber.STIFFENER, flex.name, flex.stiffener),
    }
    drilled = {"drill": gerber.drill_text(flex.name, flex.alignment_holes, n_layers=flex.n_layers)}
    if flex.shield_net:
        layers["shield"] = gerber.gerber_text(gerber.SHIELD, flex.name, [*flex.shield, *flex.via_pads])
        layers["shield-coverlay"] = gerber.gerber_text(gerber.SHIELD_COVERLAY, flex.name, flex.sheet_opening)
        vias = [(place, dimensions.VIA_HOLE_MM) for place in flex.vias]
        drilled["vias"] = gerber.drill_text(flex.name, vias, n_layers=flex.n_layers, plated=True)
    for name, text in layers.items():
        (folder / f"{name}.gbr").write_text(text)
    for name, text in drilled.items():
        (folder / f"{name}.drl").write_text(text)
