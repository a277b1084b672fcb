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


#: Chips of board `fdc1004`; of board `fdc1004_columns` all parts but the connectors of the flexes
#: (firmware_interface/README.md).
ELECTRONICS: dict[str, tuple[ElectronicPart, ...]] = {
    "fdc1004": (
        ElectronicPart(1, "FDC1004", "capacitance-to-digital converter of the leg", 4.0, is_chip=True),
        ElectronicPart(1, "ADG715", "row switch of the leg", 4.0, is_chip=True),
    ),
    "fdc1004_columns": (
        ElectronicPart(
            3, "FDC1004", "capacitance-to-digital converter, one for each column", 12.0, is_chip=True
        ),
        ElectronicPart(
            1, "LTC4317", "dual address translator: columns 1 and 2 at 0x51 and 0x52", 7.0, is_chip=True
        ),
        ElectronicPart(2, "resistor", "976 kOhm, 1 %, XORL1 and XORL2 to VCC", 0.05),
        ElectronicPart(1, "resistor", "102 kOhm, 1 %, XORL1 to GND", 0.025),
        ElectronicPart(1, "resistor", "182 kOhm, 1 %, XORL2 to GND", 0.025),
        ElectronicPart(4, "resistor", "15 kOhm, pull-up of SDA and SCL of both outputs", 0.1),
        ElectronicPart(4, "capacitor", "100 nF, at each supply pin", 0.15),
        ElectronicPart(3, "capacitor", "1 uF, at each FDC1004", 0.15),
        ElectronicPart(1, "connector of the leg", "4 contacts: 3.3 V, GND, SDA, SCL", 0.4),
    ),
}


def chips(board: str) -> list[ElectronicPart]:
    """Return the chips in a foot of a board."""
    return [part for part in ELECTRONICS[board] if part.is_chip]
