"""What makes a leg's chips fail: each stands in front of a chip, or in its place, and does what a bus would see."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from footsense.sim.bus.i2c_bus import SimulatedChip
from footsense.sim.chips.ad7746 import SimulatedAd7746
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.chips.line_switch import SimulatedLineSwitch
from footsense.sim.faults.scene_faults import (
    Absent,
    BrownOut,
    DeafSwitch,
    Garbled,
    NackAtRandom,
    OnChips,
    Span,
    StuckConverter,
    WrongChip,
    during,
)
from footsense.sim.faults.schedule import Schedule

_When = TypeVar("_When")
#: Longer than any transaction [ns].
_TRANSACTION_NS = 1_000_000_000


class _Loose:
    """A chip whose acknowledge is lost at random."""

    def __init__(self, chip: SimulatedChip, span_ns: Span, rate_rel: float, rng: np.random.Generator) -> None:
        self.address = chip.address
        self._chip = chip
        self._spans = [span_ns]
        self._rate_rel = rate_rel
        self._rng = rng
        self.write, self.read = chip.write, chip.read

    def acknowledges(self, t_ns: int) -> bool:
        lost = during(self._spans, t_ns) and self._rng.random() < self._rate_rel
        return self._chip.acknowledges(t_ns) and not lost


class _Noisy:
    """A chip of whose answers a bit is wrong at random."""

    def __init__(self, chip: SimulatedChip, span_ns: Span, rate_rel: float, rng: np.random.Generator) -> None:
        self.address = chip.address
        self._chip = chip
        self._spans = [span_ns]
        self._rate_rel = rate_rel
        self._rng = rng
        self.write, self.acknowledges = chip.write, chip.acknowledges

    def read(self, n: int, t_ns: int) -> bytes:
        answer = self._chip.read(n, t_ns)
        if not during(self._spans, t_ns) or self._rng.random() >= self._rate_rel:
            return answer
        spoilt = bytearray(answer)
        bit = int(self._rng.integers(8 * n))
        spoilt[bit // 8] ^= 0x80 >> bit % 8
        return bytes(spoilt)


class _Eeprom:
    """A 24C02 that answers at the converter's address during a span of time; each byte in it is its address."""

    def __init__(self, chip: SimulatedChip, span_ns: Span) -> None:
        self.address = chip.address
        self._chip = chip
        self._spans = [span_ns]
        self._pointer = 0
        self._memory = bytearray(range(256))

    def acknowledges(self, t_ns: int) -> bool:
        return during(self._spans, t_ns) or self._chip.acknowledges(t_ns)

    def write(self, data: bytes, t_ns: int) -> None:
        if not during(self._spans, t_ns):
            self._chip.write(data, t_ns)
            return
        self._pointer = data[0]
        for value in data[1:]:
            self._memory[self._pointer] = value
            self._pointer = (self._pointer + 1) % 256

    def read(self, n: int, t_ns: int) -> bytes:
        if not during(self._spans, t_ns):
            return self._chip.read(n, t_ns)
        return bytes(self._memory[(self._pointer + k) % 256] for k in range(n))


class _Failing:
    """A chip, or what stands in front of it while something acts on the leg: on a long script of faults that is rare.

    What stands in front looks at the time by itself and may stand there too early: so once a transaction is enough.
    """

    def __init__(self, chip: SimulatedChip, front: SimulatedChip, spans_ns: Sequence[Span]) -> None:
        self.address = chip.address
        self._chip, self._front = chip, front
        self._fails = Schedule(
            ((from_ns - _TRANSACTION_NS, until_ns), True) for from_ns, until_ns in spans_ns
        )
        self._now = chip
        self.write, self.read = chip.write, chip.read

    def acknowledges(self, t_ns: int) -> bool:
        now = self._front if self._fails.at(t_ns) else self._chip
        if now is not self._now:
            self._now = now
            self.write, self.read = now.write, now.read
        return now.acknowledges(t_ns)


def _note(when: _When, *lists: list[_When]) -> None:
    for each in lists:
        each.append(when)


def failing_chips(
    converter: SimulatedFdc1004 | SimulatedAd7746,
    switches: Sequence[SimulatedLineSwitch],
    faults: list[OnChips],
    rng: np.random.Generator,
) -> tuple[SimulatedChip, ...]:
    """Return the chips of a leg as its bus sees them, its converter first.

    Args:
        converter: The leg's converter.
        switches: The leg's line switches.
        faults: What breaks on this leg.
        rng: Of what happens at random.
    """
    whole: tuple[SimulatedChip, ...] = (converter, *switches)
    chips = whole
    for fault in faults:
        match fault:
            case Absent():
                _note(fault.span_ns, *(chip.absent_ns for chip in (converter, *switches)))
            case BrownOut():
                _note(fault.at_ns, *(chip.brown_outs_ns for chip in (converter, *switches)))
            case DeafSwitch():
                switches[0].deaf_ns.append(fault.span_ns)
            case StuckConverter():
                converter.stuck_ns.append(fault.span_ns)
            case WrongChip():
                chips = _Eeprom(chips[0], fault.span_ns), *chips[1:]
            case NackAtRandom(rate_rel=rate_rel, span_ns=span_ns):
                chips = tuple(_Loose(chip, span_ns, rate_rel, rng) for chip in chips)
            case Garbled(rate_rel=rate_rel, span_ns=span_ns):
                chips = tuple(_Noisy(chip, span_ns, rate_rel, rng) for chip in chips)
    spans_ns = [fault.span_ns for fault in faults if isinstance(fault, WrongChip | NackAtRandom | Garbled)]
    if not spans_ns:
        return whole
    return tuple(_Failing(chip, front, spans_ns) for chip, front in zip(whole, chips, strict=True))
