"""Addresses behind an LTC4317, the dual I2C address translator in a foot of board `fdc1004_columns`.

Source: Analog Devices LTC4316 and LTC4317 data sheets, section Operation, tables 2 and 3: on the way from its input to
an output the translator inverts those bits of an address that its translation byte has, and passes on all else. Two
resistor dividers of each output set the byte, read at power-up or when ENABLE rises: XORL the lower four bits, XORH the
upper three.

An output does not answer by itself: a translator that is dead, or not ready yet, is a chip that does not acknowledge.
Behind a translation of zero, or with XORH at the supply (pass-through), a chip answers at its own address.
"""

from firmware_interface.chips import fdc1004

#: Translation bytes of the converters of columns 0 to 2. That of column 0 is on the input side, without a translator;
#: XORH of both outputs is at ground, XORL has 976 kOhm to the supply and 102 or 182 kOhm to ground.
COLUMN_TRANSLATIONS = (0b000, 0b001, 0b010)


def input_address(chip_address: int, translation: int) -> int:
    """Return the 7-bit address on the input side at which a chip on the output side answers.

    Args:
        chip_address: Its own 7-bit address.
        translation: Translation byte of the output, 7 bits.

    Raises:
        ValueError: One of them has more than seven bits.

    Example:
        >>> hex(input_address(0x50, 0b001))
        '0x51'
    """
    if not (0 <= chip_address <= 0x7F and 0 <= translation <= 0x7F):
        raise ValueError(
            f"an address has seven bits, got {chip_address:#x} and the translation {translation:#x}"
        )
    return chip_address ^ translation


#: 7-bit addresses of the converters of columns 0 to 2: 0x50, 0x51, 0x52.
COLUMN_ADDRESSES = tuple(input_address(fdc1004.ADDRESS, byte) for byte in COLUMN_TRANSLATIONS)
