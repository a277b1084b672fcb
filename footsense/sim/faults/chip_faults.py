"""Injected faults of a leg's chips, simulated in the chips themselves or by a wrapper around them."""

from collections.abc import Sequence

import numpy as np

from footsense.sim.chips.ad7147 import SimulatedAd7147
from footsense.sim.chips.chip import SimulatedChip, SimulatedConverter, SimulatedLineSwitch
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.faults import scene_faults
from footsense.sim.faults.scene_faults import Schedule

#: A simulated capacitance converter of any board.
LegConverter = SimulatedFdc1004 | SimulatedAd7147


class SimulatedEeprom:
    """Simulated 24C02 EEPROM: reads and writes advance a pointer; each byte initially holds its address."""

    def __init__(self) -> None:
        self._pointer = 0
        self._memory = bytearray(range(256))

    def write(self, data: bytes) -> None:
        """Process written bytes: an address pointer, then data bytes to store from there on."""
        self._pointer = data[0]
        for value in data[1:]:
            self._memory[self._pointer] = value
            self._pointer = (self._pointer + 1) % 256

    def read(self, n: int) -> bytes:
        """Return `n` bytes from the address pointer on."""
        return bytes(self._memory[(self._pointer + k) % 256] for k in range(n))


_WRAPPED_CHIP_FAULT_TYPES = (scene_faults.NackAtRandom, scene_faults.CorruptReads)
_WRAPPED_CONVERTER_FAULT_TYPES = (*_WRAPPED_CHIP_FAULT_TYPES, scene_faults.WrongChip)


class _FailingChip:
    """Wrapper of a chip: it drops acknowledges, corrupts answers, or answers as an EEPROM while a fault is active."""

    def __init__(
        self,
        chip: SimulatedChip,
        faults: Sequence[scene_faults.NackAtRandom | scene_faults.CorruptReads | scene_faults.WrongChip],
        rng: np.random.Generator,
    ) -> None:
        self.address = chip.address
        self._chip = chip
        self._faults = Schedule((fault.span_ns, fault) for fault in faults)
        self._rng = rng
        self._eeprom = SimulatedEeprom()

    def acknowledges(self, t_ns: int) -> bool:
        lost = False
        for fault in reversed(self._faults.at(t_ns)):
            if isinstance(fault, scene_faults.WrongChip):
                return not lost
            if isinstance(fault, scene_faults.NackAtRandom):
                lost |= self._rng.random() < fault.rate_rel
        return self._chip.acknowledges(t_ns) and not lost

    def write(self, data: bytes, t_ns: int) -> None:
        if any(isinstance(fault, scene_faults.WrongChip) for fault in self._faults.at(t_ns)):
            self._eeprom.write(data)
        else:
            self._chip.write(data, t_ns)

    def read(self, n: int, t_ns: int) -> bytes:
        acting = self._faults.at(t_ns)
        if not acting:
            return self._chip.read(n, t_ns)
        replaced = any(isinstance(fault, scene_faults.WrongChip) for fault in acting)
        answer = bytearray(self._eeprom.read(n) if replaced else self._chip.read(n, t_ns))
        for fault in acting:
            if isinstance(fault, scene_faults.CorruptReads) and self._rng.random() < fault.rate_rel:
                bit = int(self._rng.integers(8 * n))
                answer[bit // 8] ^= 0x80 >> bit % 8
        return bytes(answer)


def _inject_fault(chip: LegConverter | SimulatedLineSwitch, fault: scene_faults.ChipFault) -> None:
    """Inject a fault that a chip simulates by itself."""
    match fault:
        case scene_faults.Absent():
            chip.absent_ns.append(fault.span_ns)
        case scene_faults.BrownOut():
            chip.brown_outs_ns.append(fault.at_ns)
        case scene_faults.StuckConverter() if isinstance(chip, SimulatedConverter):
            chip.stuck_ns.append(fault.span_ns)
        case scene_faults.HungConverter() if isinstance(chip, SimulatedConverter):
            chip.hangs_ns.append(fault.at_ns)
        case _:
            pass


def inject_chip_faults(
    converter: LegConverter,
    switch: SimulatedLineSwitch | None,
    faults: Sequence[scene_faults.ChipFault],
    rng: np.random.Generator,
) -> tuple[SimulatedChip, ...]:
    """Return a leg's chips with its faults injected, the converter first.

    Args:
        converter: The leg's converter.
        switch: The leg's row switch; None without one.
        faults: Faults on the chips of this leg.
        rng: Source of random acknowledges and bits.
    """
    chips: tuple[LegConverter | SimulatedLineSwitch, ...] = tuple(filter(None, (converter, switch)))
    for fault in faults:
        if isinstance(fault, scene_faults.SwitchIgnoresWrites) and switch is not None:
            switch.ignores_writes_ns.append(fault.span_ns)
        hit = chips if isinstance(fault, scene_faults.Absent | scene_faults.BrownOut) else chips[:1]
        for chip in hit:
            _inject_fault(chip, fault)
    failing: list[SimulatedChip] = []
    for chip in chips:
        kinds = _WRAPPED_CHIP_FAULT_TYPES if chip is switch else _WRAPPED_CONVERTER_FAULT_TYPES
        own = [fault for fault in faults if isinstance(fault, kinds)]
        failing.append(_FailingChip(chip, own, rng) if own else chip)
    return tuple(failing)
