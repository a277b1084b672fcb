"""Data byte of the ADG715 octal analog switch, which selects the row lines of a foot.

Source: Analog Devices ADG714/ADG715 data sheet rev. B. One data byte, bit n closes switch n + 1; all switches are
open after power-up. The address is 1001 0 A1 A0, with A1 A0 = 01.

Switches 1..3 connect rows 0..2 of a foot to ground, by which they are selected and measured; switches 4..6 connect them
to the shield: an unselected row follows the measured column, and drops out.
"""

#: 7-bit bus address with A1 A0 = 01.
ADDRESS = 0x49

#: Rows of a foot, and its columns.
N_LINES = 3
_ALL_LINES = (1 << N_LINES) - 1


def line_switch_byte(lines: int) -> int:
    """Return the data byte that selects the lines of a bit mask and connects all others as unselected.

    Args:
        lines: The mask.

    Raises:
        ValueError: The mask has more bits than a foot has rows or columns.

    Example:
        >>> [bin(line_switch_byte(1 << line)) for line in range(3)]
        ['0b110001', '0b101010', '0b11100']
    """
    if not 0 <= lines <= _ALL_LINES:
        raise ValueError(f"a foot has {N_LINES} rows and {N_LINES} columns, got the mask {lines:#b}")
    return lines | (_ALL_LINES & ~lines) << N_LINES


def selected_lines(switches: int) -> int:
    """Return the bit mask of the lines that a data byte selects."""
    return switches & _ALL_LINES


def unselected_lines(switches: int) -> int:
    """Return the bit mask of the lines that a data byte connects as unselected."""
    return switches >> N_LINES & _ALL_LINES
