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


#: Of board `ad7147` all parts but the connectors of the flexes (docs/wiring.md); of board `fdc1004` its chips.
ELECTRONICS: dict[str, tuple[ElectronicPart, ...]] = {
    "ad7147": (
        ElectronicPart(
            1,
            "AD7147-1",
            "capacitance-to-digital converter with I2C, LFCSP-24 (the AD7147 without -1 has SPI)",
            4.0,
            is_chip=True,
        ),
        ElectronicPart(1, "regulator", "3.0 V, 10 mA or more, at VCC: the chip takes 2.6 to 3.3 V", 0.4),
        ElectronicPart(
            1, "capacitor", "4.7 pF, C0G, 1 %, from CIN12 to GND: the reference of all forces", 0.1
        ),
        ElectronicPart(3, "capacitor", "100 nF, at VCC, VDRIVE and BIAS", 0.1),
        ElectronicPart(2, "capacitor", "1 uF, at input and output of the regulator", 0.1),
        ElectronicPart(
            2, "resistor", "0 Ohm, ADD0 and ADD1 each to GND or VDRIVE: address 0x2C to 0x2F", 0.05
        ),
        ElectronicPart(1, "connector of the leg", "4 contacts: 3.3 V, GND, SDA, SCL", 0.4),
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
