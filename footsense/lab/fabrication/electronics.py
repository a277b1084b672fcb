"""Chips in a foot, by board."""

from typing import NamedTuple


class Chip(NamedTuple):
    """An integrated circuit of a foot.

    Attributes:
        name: Its type.
        specification: What it is.
        price_usd: Planning value for tens of pieces, no quotation [USD].
    """

    name: str
    specification: str
    price_usd: float


#: Chips of each board. Of `ad7147` the others are parts of the converter board (docs/converter-board.md).
CHIPS: dict[str, tuple[Chip, ...]] = {
    "ad7147": (
        Chip(
            "AD7147-1",
            "capacitance-to-digital converter with I2C, LFCSP-24 (the AD7147 without -1 has SPI)",
            4.0,
        ),
    ),
    "fdc1004": (
        Chip("FDC1004", "capacitance-to-digital converter of the leg", 4.0),
        Chip("ADG715", "row switch of the leg", 4.0),
    ),
}
