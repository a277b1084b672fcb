"""The chips of one leg, wired to its foot: a capacitance converter, and the row switch in front of an FDC1004."""

from typing import NamedTuple

import numpy as np

from firmware_interface.chips import ad7147
from footsense.frames import ELEMENTS, ROWS
from footsense.sim.chips.ad7147 import InputCapacitance, SimulatedAd7147
from footsense.sim.chips.beside import BesideColumns, BesideInputs
from footsense.sim.chips.chip import SimulatedConverter, SimulatedLineSwitch
from footsense.sim.chips.fdc1004 import MeanCinCapacitance, SimulatedFdc1004
from footsense.sim.couplings import BoardCouplings
from footsense.sim.faults.damage import OPEN_ELEMENT_PF, WiredFoot
from footsense.sim.scene import Effects

#: Random streams of a leg besides that of its noise.
_COMMON_NOISE_DRAW, _AD7147_DRAW, _SHIFT_DRAW = 7, 10, 11

#: Reference capacitor on a spare input of board `ad7147`, of class C0G, whose 30 ppm/K do not count: its input, nominal
#: capacitance [pF], and tolerance [1].
REFERENCE_INPUT = 12
REFERENCE_PF = 4.7
REFERENCE_TOLERANCE_REL = 0.01


class LegElectronics(NamedTuple):
    """The chips of one fault-free leg.

    Attributes:
        converter: Its converter.
        switch: Its row switch; None with board `ad7147`.
    """

    converter: SimulatedFdc1004 | SimulatedAd7147
    switch: SimulatedLineSwitch | None


def leg_electronics(
    board: str,
    foot: WiredFoot,
    effects: Effects,
    seed: tuple[int, int],
    couplings: BoardCouplings | None = None,
    address: int = ad7147.ADDRESSES[0],
    bus_clock_hz: int = 400_000,
) -> LegElectronics:
    """Return the chips of one fault-free leg.

    Args:
        board: `fdc1004` or `ad7147`.
        foot: The foot behind them.
        effects: Noise, clock error, stray, warming and kind of chip.
        seed: Seeds of the scene and of the leg.
        couplings: Couplings of the foot's lines with the board; None for none.
        address: Address of the converter, of board `ad7147`.
        bus_clock_hz: Clock of its bus [Hz], which board `ad7147` depends on.
    """
    beside = effects.couplings
    if board == "ad7147":
        inputs = None
        if beside is not None and couplings is not None:
            inputs = BesideInputs(couplings, beside.shield_error_rel)
        return LegElectronics(_ad7147(foot, effects, seed, inputs, address, bus_clock_hz), None)
    rows = SimulatedLineSwitch()
    of_columns = None
    if beside is not None and couplings is not None:
        of_columns = BesideColumns(couplings, beside.idle_inputs, beside.shield_error_rel)
    pins = _column_pin_capacitance(foot, rows, effects.stray_pf, of_columns)
    return LegElectronics(_fdc1004(pins, effects, seed), rows)


def _share_noise(chip: SimulatedConverter, effects: Effects, seed: tuple[int, ...]) -> None:
    """Make a share of a converter's noise common to its channels, where the effects say so."""
    if effects.converter_noise and effects.common_noise_rel:
        chip.share_noise(effects.common_noise_rel, np.random.default_rng((*seed, _COMMON_NOISE_DRAW)))


def _ad7147(
    foot: WiredFoot,
    effects: Effects,
    seed: tuple[int, int],
    beside: BesideInputs | None,
    address: int,
    bus_clock_hz: int,
) -> SimulatedAd7147:
    """Return a fault-free AD7147 with its own noise, clock, gain, steps of offset and reference capacitor."""
    random, draw = np.random.default_rng(seed), np.random.default_rng((*seed, _AD7147_DRAW))
    kind, warming = effects.ad7147, effects.warming
    gain, offset, reference = draw.uniform(-1, 1, 3)
    reference_pf = REFERENCE_PF * (1.0 + REFERENCE_TOLERANCE_REL * float(reference))
    clock_error_rel = effects.converter_clock_rel * random.uniform(-1, 1)
    chip = SimulatedAd7147(
        _single_input_capacitance(foot, effects.stray_pf, reference_pf, beside),
        random if effects.converter_noise else None,
        clock_error_rel,
        address=address,
        effects=kind,
        gain_rel=kind.gain_rel * float(gain),
        offset_rel=kind.offset_rel * float(offset),
        temperature_change_k=warming.temperature_change_k_at if warming else None,
        bus_clock_hz=bus_clock_hz,
        shifts=np.random.default_rng((*seed, _SHIFT_DRAW)) if kind.shifted_burst_rel else None,
    )
    _share_noise(chip, effects, seed)
    return chip


def _fdc1004(pins: MeanCinCapacitance, effects: Effects, seed: tuple[int, ...]) -> SimulatedFdc1004:
    """Return a fault-free FDC1004 with its own noise and clock."""
    random = np.random.default_rng(seed)
    noise = random if effects.converter_noise else None
    chip = SimulatedFdc1004(pins, noise, effects.converter_clock_rel * random.uniform(-1, 1))
    chip.trigger_clears_done = effects.trigger_clears_done
    chip.done_needs_both_reads = effects.done_needs_both_reads
    chip.keeps_old_result = effects.keeps_old_result
    _share_noise(chip, effects, seed)
    return chip


def _single_input_capacitance(
    foot: WiredFoot, stray_pf: float, reference_pf: float, beside: BesideInputs | None
) -> InputCapacitance:
    """Return the capacitance function of board `ad7147`: an input for each element, and the reference capacitor."""

    def input_pf(
        cin: int, connections: tuple[ad7147.InputConnection, ...], t_start_ns: int, t_end_ns: int
    ) -> float:
        if cin == REFERENCE_INPUT:
            return reference_pf
        t_ns, element = (t_start_ns + t_end_ns) // 2, cin
        added_pf, disturbances = 0.0, foot.disturbances
        if disturbances is not None:
            element = disturbances.column_of_pin(cin, t_ns)  # of this board the inputs are elements
            row, column = divmod(element, ROWS)
            added_pf = disturbances.added_pf(1 << row, column, t_start_ns, t_end_ns)
        if element >= ELEMENTS:  # an input without a line
            return added_pf + OPEN_ELEMENT_PF
        elements_pf = foot.elements_pf(t_ns)
        if beside is not None:
            added_pf += beside.added_pf(element, elements_pf, connections)
        return added_pf + foot.element_pin_pf(element, elements_pf[element] + stray_pf, t_ns)

    return input_pf


def _column_pin_capacitance(
    foot: WiredFoot, rows: SimulatedLineSwitch, stray_pf: float, beside: BesideColumns | None
) -> MeanCinCapacitance:
    """Return the capacitance function of board `fdc1004`'s pins: a column's elements to ground, and stray."""

    def pin_pf(cin: int, t_start_ns: int, t_end_ns: int) -> float:
        # The load is that of the middle of the conversion; the rows are weighted by their share of it.
        t_ns = (t_start_ns + t_end_ns) // 2
        total_pf, disturbances = 0.0, foot.disturbances
        if disturbances is not None:
            cin = disturbances.column_of_pin(cin, t_ns)
            total_pf = disturbances.added_pf(
                rows.states_between(t_start_ns, t_end_ns)[0][1].selected_mask, cin, t_start_ns, t_end_ns
            )
            if cin >= ROWS:  # a pin without a line
                return total_pf + OPEN_ELEMENT_PF
        element_pf = [pf + stray_pf for pf in foot.elements_pf(t_ns)]
        column_pf = element_pf[cin::ROWS]
        for share, states in rows.states_between(t_start_ns, t_end_ns):
            line_pf = foot.pin_pf(cin, column_pf, states, t_ns)
            if beside is not None and line_pf != OPEN_ELEMENT_PF:
                line_pf += beside.added_pf(cin, element_pf, states)
            total_pf += share * line_pf
        return total_pf

    return pin_pf
