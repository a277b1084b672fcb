"""The ADG715 octal analog switch, which selects the lines of a foot.

Source: Analog Devices ADG714/ADG715 data sheet rev. B. One data byte, bit n closes switch n + 1; all switches are
open after power-up. The address is 1001 0 A1 A0; A1 A0 = 01 and 10 keep it clear of an AD7746 at 0x48.

Switches 1..3 connect lines 0..2 to the node of a selected line, switches 4..6 to that of a waiting line:

| board | address | lines | selected | waiting |
|---|---|---|---|---|
| `fdc1004` | 0x49 | rows | ground: the row is measured | shield: follows the measured column, and drops out |
| `ad7746` | 0x49 | rows | EXCA: the row is measured | ground |
| `ad7746` | 0x4A | columns | CIN1: the column is measured | ground |
"""

#: 7-bit bus address with A1 A0 = 01: the rows.
ADDRESS = 0x49
#: 7-bit bus address with A1 A0 = 10: the columns, where a board switches them.
COLUMN_ADDRESS = 0x4A

LINES = 3
_WAITING_SHIFT = LINES
_ALL_LINES = (1 << LINES) - 1


def select_lines(lines: int) -> int:
    """Return the switch byte that selects the lines in a bit mask and connects the others as waiting.

    Raises:
        ValueError: The mask has more bits than a foot has rows or columns.

    Example:
        >>> [bin(select_lines(1 << line)) for line in range(3)]
        ['0b110001', '0b101010', '0b11100']
    """
    if not 0 <= lines <= _ALL_LINES:
        raise ValueError(f"a foot has {LINES} rows and {LINES} columns, got the mask {lines:#b}")
    return lines | (_ALL_LINES & ~lines) << _WAITING_SHIFT


def selected_lines(switches: int) -> int:
    """Return the mask of the lines that a switch byte selects."""
    return switches & _ALL_LINES


def waiting_lines(switches: int) -> int:
    """Return the mask of the lines that a switch byte connects as waiting."""
    return switches >> _WAITING_SHIFT & _ALL_LINES
