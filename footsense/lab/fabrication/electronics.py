"""Electronics in a foot, by board: parts and planning values of their price.

The values are for tens of pieces and no quotations.
"""

from typing import NamedTuple


class ElectronicPart(NamedTuple):
    """A line of the parts list of a foot's electronics.

    Attributes:
        quantity: How many.
        name: Name, of a chip that of its type.
        specification: What it is.
        price_usd: Planning value of all of them together [USD].
        is_chip: Whether it is an integrated circuit.
    """

    quantity: int
    name: str
    specification: str
    price_usd: float
    is_chip: bool = False


#: Of board `ad7147` the chip, and the board with all other parts (docs/converter-board.md); of `fdc1004` its chips.
ELECTRONICS: dict[str, tuple[ElectronicPart, ...]] = {
    "ad7147": (
        ElectronicPart(
            1,
            "AD7147-1",
            "capacitance-to-digital converter with I2C, LFCSP-24 (the AD7147 without -1 has SPI)",
            4.0,
            is_chip=True,
        ),
        ElectronicPart(
            1,
            "converter board",
            "deploy/board of footsense, with all parts but the AD7147-1; of an order of six",
            13.8,
        ),
        ElectronicPart(4, "screw of the converter board", "M2 x 8", 0.2),
    ),
    "fdc1004": (
        ElectronicPart(1, "FDC1004", "capacitance-to-digital converter of the leg", 4.0, is_chip=True),
        ElectronicPart(1, "ADG715", "row switch of the leg", 4.0, is_chip=True),
    ),
}


def has_element_lines(board: str) -> bool:
    """Return whether each element has a line of its own to the board, in place of each row and column."""
    return board == "ad7147"


def chips(board: str) -> list[ElectronicPart]:
    """Return the chips in a foot of a board."""
    return [part for part in ELECTRONICS[board] if part.is_chip]
