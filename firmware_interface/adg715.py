"""The ADG715 octal analog switch, and how it selects one row of a foot.

Source: Analog Devices ADG714/ADG715 data sheet rev. B. One data byte, bit n closes switch n + 1; all switches are
open after power-up. The address is 1001 0 A1 A0; A1 A0 = 01 keeps it clear of an AD7746 at 0x48.

Wiring of one foot (board `fdc1004`): switches 1..3 put rows 0..2 to ground, switches 4..6 put them to the shield
driver. A row at ground is measured; a row at the shield follows the measured column and drops out.
"""

#: 7-bit bus address with A1 A0 = 01.
ADDRESS = 0x49

ROWS = 3
_SHIELD_SHIFT = ROWS
_ALL_ROWS = (1 << ROWS) - 1


def select_rows(rows_to_ground: int) -> int:
    """Return the switch byte that grounds the rows in the bit mask and shields the others.

    Raises:
        ValueError: The mask has more bits than a foot has rows.

    Example:
        >>> [bin(select_rows(1 << row)) for row in range(3)]
        ['0b110001', '0b101010', '0b11100']
    """
    if not 0 <= rows_to_ground <= _ALL_ROWS:
        raise ValueError(f"a foot has {ROWS} rows, got the mask {rows_to_ground:#b}")
    return rows_to_ground | (_ALL_ROWS & ~rows_to_ground) << _SHIELD_SHIFT


#: The switch byte that grounds every row: each pin then sees its whole column.
ALL_ROWS = select_rows(_ALL_ROWS)


def grounded_rows(switches: int) -> int:
    """Return the mask of the rows that a switch byte connects to ground."""
    return switches & _ALL_ROWS


def shielded_rows(switches: int) -> int:
    """Return the mask of the rows that a switch byte connects to the shield."""
    return switches >> _SHIELD_SHIFT & _ALL_ROWS
