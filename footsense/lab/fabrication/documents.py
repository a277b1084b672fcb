"""Documents of a foot: overview, bill of materials, assembly steps with the tolerances, checklist."""

import math
from pathlib import Path
from typing import Any

from footsense.frames import ROWS
from footsense.lab.design.materials import shore_a_from_modulus
from footsense.lab.design.processes import AssumedProcess
from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.electronics import CHIPS, has_element_lines
from footsense.lab.fabrication.parts.flex import (
    AD7147_GUARD_NET,
    COMMON_NET,
    GUARD_NET,
    Board,
    Flex,
    element_net,
)
from footsense.lab.fabrication.tolerances import ExpectedCapacitance, Tolerance
from footsense.lab.geometry import UM_PER_MM, FootDesign
from footsense.lab.template import render

#: Density of the rubbers and of PDMS, for the amounts to weigh [g/cm3]; the paper's butadiene rubber has 0.91.
_RUBBER_DENSITY_G_PER_CM3 = 1.1
#: What is weighed over what ends up in the part [1].
_CASTING_EXCESS_FACTOR = 1.3


def write_documents(
    folder: Path,
    design: FootDesign,
    board: Board,
    assumed: AssumedProcess,
    flexes: tuple[Flex, Flex],
    tolerances: list[Tolerance],
    expected: ExpectedCapacitance,
) -> None:
    """Write overview, assembly steps, checklist and bill of materials of a foot.

    Args:
        folder: Where they are written.
        design: The foot.
        board: Its electronics.
        assumed: What its design assumed.
        flexes: The lower and the upper one.
        tolerances: Tolerances of the parts.
        expected: Expected reading of each element.
    """
    names: dict[str, Any] = {
        "design": design,
        "assumed": assumed,
        "dimensions": dimensions,
        "board": board,
        "flexes": flexes,
        "has_element_lines": has_element_lines(board),
        "chips": CHIPS[board],
        "contacts": {flex.name: connector_contacts(flex, board) for flex in flexes},
        "tolerances": tolerances,
        "expected": expected,
        "elements": [
            (f"row{row}", f"col{column}") for row in range(1, ROWS + 1) for column in range(1, ROWS + 1)
        ],
        "shore": shore_a_from_modulus(design.rubber.youngs_mpa),
        "rubber_g": rubber_mass_to_weigh_g(design),
        "film_material": film_material_text(design),
        "UM_PER_MM": UM_PER_MM,
    }
    for name in ("README.md", "assembly.md", "checklist.md", "bill-of-materials.csv"):
        (folder / name).write_text(render(f"lab/fabrication/{name}", names))


def film_material_text(design: FootDesign) -> str:
    """Return material name and permittivity of the insulating film as text; the name follows from the permittivity."""
    known = {2.7: "PDMS", 3.2: "polyester", 3.4: "polyimide"}
    name = known.get(round(design.film_eps_r, 1), "polymer")
    return f"{name}, relative permittivity {design.film_eps_r:g}"


def rubber_mass_to_weigh_g(design: FootDesign) -> float:
    """Return the mass of rubber to weigh for both hemispheres of a foot, casting excess included [g]."""
    ball_cm3 = 4.0 / 3.0 * math.pi * design.ball_radius_mm**3 / 1000.0
    return _CASTING_EXCESS_FACTOR * _RUBBER_DENSITY_G_PER_CM3 * ball_cm3


def connector_contacts(flex: Flex, board: Board) -> list[tuple[str, str]]:
    """Return per contact of a flex its net, and its pin on the board."""
    return [(net, _PINS[board][net]) for net in flex.contacts]


#: Pin of each net of a board.
_PINS: dict[Board, dict[str, str]] = {
    "ad7147": {
        COMMON_NET: "GND",
        AD7147_GUARD_NET: "AD7147: ACSHIELD",
        **{
            element_net(row, column): f"AD7147: CIN{ROWS * row + column}"
            for row in range(ROWS)
            for column in range(ROWS)
        },
    },
    "fdc1004": {
        GUARD_NET: "SHLD",
        **{f"row{k + 1}": f"ADG715 0x49: S{k + 1} (to GND), S{ROWS + k + 1} (to SHLD)" for k in range(ROWS)},
        **{f"col{k + 1}": f"FDC1004: CIN{k + 1}" for k in range(ROWS)},
    },
}
