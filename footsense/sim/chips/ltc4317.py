"""Simulated LTC4317 address translator: the converters of a foot behind its two outputs, at translated addresses.

Simulated (data sheet, section Operation): the exclusive or of address and translation byte; an output that is dead
passes nothing, so that its chip does not acknowledge; one whose resistors are wrong has another translation. Not
simulated: the time from power-up until READY, the stuck bus timeout, and the delay of SDA, of a quarter of a
microsecond.
"""

from collections.abc import Sequence

from firmware_interface.chips.ltc4317 import COLUMN_TRANSLATIONS, input_address
from footsense.sim.chips.chip import SimulatedChip
from footsense.sim.faults import scene_faults
from footsense.sim.faults.scene_faults import Schedule


class TranslatedChip:
    """A chip as it is seen from the input side of a translator.

    Args:
        chip: The chip.
        translation: Translation byte of its output.
        faults: Faults of the output.
        when_faulty: Whether the chip answers at this address while a fault acts, instead of else.

    Attributes:
        address: Address on the input side.
    """

    def __init__(
        self,
        chip: SimulatedChip,
        translation: int,
        faults: Sequence[scene_faults.TranslatorDead | scene_faults.ConvertersCollide],
        *,
        when_faulty: bool = False,
    ) -> None:
        self.address = input_address(chip.address, translation)
        self._chip = chip
        self._faults = Schedule((fault.span_ns, fault) for fault in faults)
        self._when_faulty = when_faulty

    def acknowledges(self, t_ns: int) -> bool:
        """Return whether the chip acknowledges, and the output has this translation at a time [ns]."""
        return bool(self._faults.at(t_ns)) == self._when_faulty and self._chip.acknowledges(t_ns)

    def write(self, data: bytes, t_ns: int) -> None:
        """Pass on the bytes of a write."""
        self._chip.write(data, t_ns)

    def read(self, n: int, t_ns: int) -> bytes:
        """Pass on the bytes of a read."""
        return self._chip.read(n, t_ns)


def translated_columns(
    converters: Sequence[SimulatedChip], faults: Sequence[scene_faults.ChipFault]
) -> list[SimulatedChip]:
    """Return the converters of columns 0 to 2 of a foot as its bus sees them.

    Args:
        converters: The three converters, each at its own address.
        faults: Faults on the chips of this leg.
    """
    dead = [fault for fault in faults if isinstance(fault, scene_faults.TranslatorDead)]
    seen: list[SimulatedChip] = [converters[0]]
    for column, translation in list(enumerate(COLUMN_TRANSLATIONS))[1:]:
        wrong = [
            fault
            for fault in faults
            if isinstance(fault, scene_faults.ConvertersCollide) and fault.column == column
        ]
        seen.append(TranslatedChip(converters[column], translation, [*dead, *wrong]))
        if wrong:
            seen.append(TranslatedChip(converters[column], COLUMN_TRANSLATIONS[0], wrong, when_faulty=True))
    return seen
