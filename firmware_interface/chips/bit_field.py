"""Bit field of a 16-bit register."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Field:
    """Bit field of a 16-bit register."""

    shift: int
    width: int

    def encode(self, value: int) -> int:
        """Return `value` shifted to the field's position.

        Raises:
            ValueError: The value does not fit into the field.

        Example:
            >>> hex(Field(shift=10, width=3).encode(7))
            '0x1c00'
        """
        if not 0 <= value < 1 << self.width:
            raise ValueError(f"{value} does not fit into {self.width} bits")
        return value << self.shift

    def decode(self, word: int) -> int:
        """Return the field's value in the register value `word`.

        Example:
            >>> Field(shift=10, width=2).decode(0x0C80)
            3
        """
        return (word >> self.shift) & ((1 << self.width) - 1)
