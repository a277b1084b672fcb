"""The chips of one leg, wired to its foot: capacitance converters, and the row switch in front of one."""

from typing import NamedTuple

import numpy as np

from footsense.frames import ROWS
from footsense.sim.chips.chip import SimulatedLineSwitch
from footsense.sim.chips.fdc1004 import MeanCinCapacitance, SimulatedFdc1004
from footsense.sim.faults.damage import OPEN_ELEMENT_PF, WiredFoot
from footsense.sim.scene import Effects

#: Random streams of a leg besides that of its noise.
_COMMON_NOISE_DRAW, _COLUMN_DRAW = 7, 8


class LegElectronics(NamedTuple):
    """The chips of one fault-free leg.

    Attributes:
        converters: Its converters, each with its own address.
        switches: Its row switch; none with several converters.
    """

    converters: tuple[SimulatedFdc1004, ...]
    switches: tuple[SimulatedLineSwitch, ...]


def leg_electronics(board: str, foot: WiredFoot, effects: Effects, seed: tuple[int, int]) -> LegElectronics:
    """Return the chips of one fault-free leg.

    Args:
        board: `fdc1004` or `fdc1004_columns`.
        foot: The foot behind them.
        effects: Noise, clock error and stray.
        seed: Seeds of the scene and of the leg.
    """
    if board == "fdc1004_columns":
        return LegElectronics(
            tuple(_column_converter(foot, column, effects, seed) for column in range(ROWS)), ()
        )
    rows = SimulatedLineSwitch()
    pins = _column_pin_capacitance(foot, rows, effects.stray_pf)
    return LegElectronics((_fdc1004(pins, effects, seed),), (rows,))


def _fdc1004(pins: MeanCinCapacitance, effects: Effects, seed: tuple[int, ...]) -> SimulatedFdc1004:
    """Return a fault-free FDC1004 with its own noise and clock."""
    random = np.random.default_rng(seed)
    noise = random if effects.converter_noise else None
    chip = SimulatedFdc1004(pins, noise, effects.converter_clock_rel * random.uniform(-1, 1))
    chip.trigger_clears_done = effects.trigger_clears_done
    chip.done_needs_both_reads = effects.done_needs_both_reads
    chip.keeps_old_result = effects.keeps_old_result
    if noise is not None and effects.common_noise_rel:
        common_noise = np.random.default_rng((*seed, _COMMON_NOISE_DRAW))
        chip.share_noise(effects.common_noise_rel, common_noise)
    return chip


def _column_converter(
    foot: WiredFoot, column: int, effects: Effects, seed: tuple[int, int]
) -> SimulatedFdc1004:
    """Return the fault-free converter of a column of board `fdc1004_columns`, of its own kind."""
    stream = (_COLUMN_DRAW, column) if column else ()
    chip = _fdc1004(_element_pin_capacitance(foot, column, effects.stray_pf), effects, (*seed, *stream))
    odd = effects.odd_column
    if odd is not None and odd.column == column:
        chip.clock_factor += odd.slower_rel
        chip.trigger_clears_done = odd.trigger_clears_done
        chip.done_needs_both_reads = odd.done_needs_both_reads
    return chip


def _element_pin_capacitance(foot: WiredFoot, column: int, stray_pf: float) -> MeanCinCapacitance:
    """Return the capacitance function of a converter of board `fdc1004_columns`: a pin for each row of its column."""

    def pin_pf(cin: int, t_start_ns: int, t_end_ns: int) -> float:
        t_ns, row = (t_start_ns + t_end_ns) // 2, cin
        added_pf, disturbances = 0.0, foot.disturbances
        if disturbances is not None:
            row = disturbances.column_of_pin(cin, t_ns)  # of this board the pins are rows
            added_pf = disturbances.added_pf(1 << row, column, t_start_ns, t_end_ns)
        if row >= ROWS:  # a pin without a line
            return added_pf + OPEN_ELEMENT_PF
        element = row * ROWS + column
        return added_pf + foot.element_pin_pf(element, foot.elements_pf(t_ns)[element] + stray_pf, t_ns)

    return pin_pf


def _column_pin_capacitance(
    foot: WiredFoot, rows: SimulatedLineSwitch, stray_pf: float
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
        column_pf = [pf + stray_pf for pf in foot.elements_pf(t_ns)[cin::ROWS]]
        for share, states in rows.states_between(t_start_ns, t_end_ns):
            total_pf += share * foot.pin_pf(cin, column_pf, states, t_ns)
        return total_pf

    return pin_pf
