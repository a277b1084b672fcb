"""Fabrication package: all files of a foot in one folder, read back and checked."""

from dataclasses import dataclass
from pathlib import Path

from footsense.errors import FootsenseError
from footsense.lab.fabrication import checks, fits
from footsense.lab.fabrication.array import ElementArray
from footsense.lab.fabrication.assumptions import AssumedProcess, assumed_process
from footsense.lab.fabrication.documents import papers
from footsense.lab.fabrication.documents.drawing import drawing_sheets, write_drawing
from footsense.lab.fabrication.documents.picture import draw_parts
from footsense.lab.fabrication.expected import ExpectedCapacitance, expected_capacitance
from footsense.lab.fabrication.limits import require_manufacturable
from footsense.lab.fabrication.parts import gerber, sheets, solids
from footsense.lab.fabrication.parts.flex import Flex, flexes
from footsense.lab.fabrication.tolerances import Tolerance, drawing_tolerances
from footsense.lab.geometry import FootDesign


@dataclass(frozen=True, slots=True, kw_only=True)
class FabricationPackage:
    """Design, parts, tolerances and check results of one foot's fabrication files.

    Attributes:
        design: The foot.
        array: Its array.
        assumed: What its design assumed.
        flexes: Row flex and column flex.
        solid_parts: Its solids.
        tolerances: Tolerances of its drawing.
        checks: Figures of the files.
        expected_by_net_pair: Expected reading of each element, by row and column net.
    """

    design: FootDesign
    array: ElementArray
    assumed: AssumedProcess
    flexes: tuple[Flex, Flex]
    solid_parts: list[solids.Part]
    tolerances: list[Tolerance]
    checks: list[checks.Check]
    expected_by_net_pair: dict[tuple[str, str], ExpectedCapacitance]


def write_fabrication_package(
    design: FootDesign, folder: Path, process: str | None = None
) -> FabricationPackage:
    """Write all fabrication files of a foot: the part files as `write_and_check_parts`, and the documents.

    Raises:
        FootsenseError: A written file is not as it should be.
    """
    package = write_and_check_parts(design, folder, process)
    write_drawing(
        folder, design.foot_type, drawing_sheets(folder, design, package.flexes, package.tolerances)
    )
    draw_parts(folder, design, package.flexes)
    papers.write_documents(
        folder,
        design,
        package.assumed,
        package.flexes,
        package.checks,
        package.tolerances,
        package.expected_by_net_pair,
    )
    wrong = next((check for check in package.checks if not check.passed), None)
    if wrong is not None:
        raise FootsenseError(
            f"{folder / wrong.file}: {wrong.quantity}: {wrong.measured}, should be {wrong.expected}; do not order "
            "from it"
        )
    return package


def write_and_check_parts(design: FootDesign, folder: Path, process: str | None = None) -> FabricationPackage:
    """Write the part files (Gerber, DXF, STEP), read them back, and return the package with its checks.

    Args:
        design: The foot.
        folder: Where they are written.
        process: Name of the process that its design assumed; None for the first with its film.

    Raises:
        ConfigError: It cannot be made; the message begins with the key.
    """
    array, assumed = ElementArray.from_design(design), assumed_process(design, process)
    require_manufacturable(design, array, assumed)
    both = flexes(array, design.ball_radius_mm)
    parts = solids.all_parts(design)
    (folder / "step").mkdir(parents=True, exist_ok=True)
    for part in parts:
        solids.write_step(part, folder / "step" / f"{part.name}.step")
    for flex in both:
        _write_flex(folder / flex.name, flex)
    shapes = {
        "spacer": (sheets.spacer_outline(array, design.ball_radius_mm), design.gap_um),
        "film": (sheets.film_outline(array, design.ball_radius_mm), design.film_um),
    }
    for name, (shape, thickness_um) in shapes.items():
        sheets.write_dxf(
            folder / f"{name}.dxf", shape, f"{design.foot_type} {name}, {thickness_um:g} um thick"
        )
    tolerances = drawing_tolerances(design, assumed.rms_deviations)
    found = [
        *(check for flex in both for check in checks.check_flex_files(folder, flex)),
        *checks.check_sheet_files(folder, array),
        *checks.check_solid_volumes(folder, parts),
        *fits.check_overlaps(folder, both),
        *fits.check_sheets_on_flexes(folder, both),
        *fits.check_hemispheres_and_socket(folder, design, both),
        *checks.check_tolerances(tolerances),
    ]
    return FabricationPackage(
        design=design,
        array=array,
        assumed=assumed,
        flexes=both,
        solid_parts=parts,
        tolerances=tolerances,
        checks=found,
        expected_by_net_pair={
            pair: expected_capacitance(design, area, assumed.rms_deviations)
            for pair, area in fits.overlaps_mm2(folder, both).items()
        },
    )


def _write_flex(folder: Path, flex: Flex) -> None:
    """Write Gerber layers and drill file of one flex into a folder."""
    folder.mkdir(exist_ok=True)
    layers = {
        "copper": (gerber.COPPER, flex.copper),
        "coverlay": (gerber.COVERLAY, flex.coverlay_openings),
        "profile": (gerber.PROFILE, flex.profile),
        "stiffener": (gerber.STIFFENER, flex.stiffener),
    }
    for name, (function, shapes) in layers.items():
        (folder / f"{name}.gbr").write_text(gerber.gerber_text(function, flex.name, shapes))
    (folder / "drill.drl").write_text(gerber.drill_text(flex.name, flex.alignment_holes))
