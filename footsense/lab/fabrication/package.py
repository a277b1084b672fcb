"""Fabrication package: all files of a foot in one folder, solids, flexes, sheets, and the documents beside them."""

import math
from pathlib import Path
from typing import NamedTuple

from footsense.errors import ConfigError
from footsense.frames import ELEMENTS, ROWS
from footsense.lab.design.materials import shore_a_from_modulus
from footsense.lab.design.processes import AssumedProcess, assumed_process
from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.electronics import CHIPS
from footsense.lab.fabrication.parts import gerber, sheets, solids
from footsense.lab.fabrication.parts.flex import (
    AD7147_GUARD_NET,
    COMMON_NET,
    GUARD_NET,
    Board,
    Flex,
    element_net,
    flexes,
)
from footsense.lab.fabrication.tolerances import (
    ExpectedCapacitance,
    expected_capacitance,
    manufacturing_problems,
    part_tolerances,
)
from footsense.lab.geometry import UM_PER_MM, FootDesign
from footsense.lab.template import render

#: Density of the rubbers and of PDMS, for the amounts to weigh [g/mm3]; the paper's butadiene rubber has 0.00091.
_RUBBER_DENSITY_G_PER_MM3 = 0.0011
#: What is weighed over what ends up in the part [1].
_CASTING_EXCESS_FACTOR = 1.3
#: Insulating films, by their relative permittivity [1].
_FILMS = {2.7: "PDMS", 3.2: "polyester", 3.4: "polyimide"}
#: Pin of each net of a board.
PINS: dict[Board, dict[str, str]] = {
    "ad7147": {
        COMMON_NET: "GND",
        AD7147_GUARD_NET: "AD7147: ACSHIELD",
        **{element_net(*divmod(element, ROWS)): f"AD7147: CIN{element}" for element in range(ELEMENTS)},
    },
    "fdc1004": {
        GUARD_NET: "SHLD",
        **{f"row{k + 1}": f"ADG715 0x49: S{k + 1} (to GND), S{ROWS + k + 1} (to SHLD)" for k in range(ROWS)},
        **{f"col{k + 1}": f"FDC1004: CIN{k + 1}" for k in range(ROWS)},
    },
}


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
    ball_mm3 = 4.0 / 3.0 * math.pi * design.ball_radius_mm**3
    film = _FILMS.get(round(design.film_eps_r, 1), "polymer")
    names = {
        **package._asdict(),
        "design": design,
        "dimensions": dimensions,
        "board": board,
        "chips": CHIPS[board],
        "pins": PINS[board],
        "tolerances": tolerances,
        "ROWS": ROWS,
        "shore": shore_a_from_modulus(design.rubber.youngs_mpa),
        "rubber_g": _CASTING_EXCESS_FACTOR * _RUBBER_DENSITY_G_PER_MM3 * ball_mm3,
        "film_material": f"{film}, relative permittivity {design.film_eps_r:g}",
        "UM_PER_MM": UM_PER_MM,
    }
    for name in ("README.md", "assembly.md", "checklist.md", "bill-of-materials.csv"):
        (folder / name).write_text(render(f"lab/fabrication/{name}", names))
    return package


def _write_flex(folder: Path, flex: Flex) -> None:
    """Write Gerber layers and drill files of one flex into a folder."""
    folder.mkdir(exist_ok=True)
    layers = {
        "copper": (gerber.COPPER, [*flex.copper, *flex.via_pads]),
        "coverlay": (gerber.COVERLAY, flex.coverlay_openings),
        "profile": (gerber.PROFILE, flex.profile),
        "stiffener": (gerber.STIFFENER, flex.stiffener),
    }
    holes = {"drill": (flex.alignment_holes, dimensions.ALIGNMENT_HOLE_DIAMETER_MM)}
    if flex.shield_net:
        layers["shield"] = (gerber.SHIELD, [*flex.shield, *flex.via_pads])
        layers["shield-coverlay"] = (gerber.SHIELD_COVERLAY, flex.sheet_opening)
        holes["vias"] = (flex.vias, dimensions.VIA_HOLE_MM)
    for name, (function, shapes) in layers.items():
        (folder / f"{name}.gbr").write_text(gerber.gerber_text(function, flex.name, shapes))
    for name, (places, diameter_mm) in holes.items():
        text = gerber.drill_text(
            flex.name, places, diameter_mm, n_layers=flex.n_layers, plated=name == "vias"
        )
        (folder / f"{name}.drl").write_text(text)
