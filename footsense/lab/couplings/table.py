"""The table of a foot type's couplings, and its file."""

from pathlib import Path

from footsense.lab.couplings.flex_couplings import BOARDS, board_couplings
from footsense.lab.geometry import FootDesign
from footsense.sim.couplings import CouplingTable


def coupling_table(design: FootDesign) -> CouplingTable:
    """Return the couplings of a foot with each board."""
    return CouplingTable(
        foot_type=design.foot_type, boards={board: board_couplings(design, board) for board in BOARDS}
    )


def write_couplings(file: Path, table: CouplingTable) -> None:
    """Write a table to a YAML file, a conductor a line."""
    lines = [
        "# Couplings of the lines of a foot [fF], of its drawn flexes: `footsense lab couplings` writes them.",
        f"foot_type: {table.foot_type}",
        "boards:",
    ]
    for board, found in table.boards.items():
        lines += [
            f"  {board}:",
            f"    conductors: [{', '.join(found.conductors)}]",
            "    mutual_ff:",
            *(f"      - [{', '.join(f'{value:.1f}' for value in row)}]" for row in found.mutual_ff),
            f"    metal_ff: [{', '.join(f'{value:.1f}' for value in found.metal_ff)}]",
        ]
    file.write_text("\n".join([*lines, ""]), encoding="utf-8")
