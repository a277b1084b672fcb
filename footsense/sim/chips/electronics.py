"""The chips of one leg, wired to its foot: capacitance converters, and the line switches in front of them."""

from functools import partial
from typing import NamedTuple

import numpy as np

from firmware_interface.chips import adg715
from footsense.frames import ROWS
from footsense.sim.chips.ad7746 import (
    CAPDAC_GAIN_RANGE_REL,
    MAX_TEMPERATURE_ERROR_K,
    MeanMutualCapacitance,
    SimulatedAd7746,
)
from footsense.sim.chips.beside import BesideColumns, BesideElements
from footsense.sim.chips.chip import SimulatedLineSwitch
from footsense.sim.chips.excitation import Excitations
from footsense.sim.chips.fdc1004 import MeanCinCapacitance, SimulatedFdc1004
from footsense.sim.couplings import BoardCouplings
from footsense.sim.faults.damage import OPEN_ELEMENT_PF, WiredFoot
from footsense.sim.scene import Effects

#: Temperature of a scene that does not change it [deg C].
ROOM_TEMPERATURE_C = 25.0

#: Random streams of a leg besides that of its noise.
_CAPDAC_DRAW, _THERMOMETER_DRAW, _COMMON_NOISE_DRAW, _COLUMN_DRAW, _PHASE_DRAW = 4, 5, 7, 8, 9


class LegElectronics(NamedTuple):
    """The chips of one fault-free leg.

    Attributes:
        converters: Its converters, each with its own address.
        switches: Its line switches, that of the rows first.
    """

    converters: tuple[SimulatedFdc1004, ...] | tuple[SimulatedAd7746]
    switches: tuple[SimulatedLineSwitch, ...]


def leg_electronics(
    board: str,
    foot: WiredFoot,
    effects: Effects,
    seed: tuple[int, int],
    couplings: BoardCouplings | None = None,
) -> LegElectronics:
    """Return the chips of one fault-free leg.

    Args:
        board: `fdc1004`, `fdc1004_columns` or `ad7746`.
        foot: The foot behind them.
        effects: Noise, clock error, stray and warming.
        seed: Seeds of the scene and of the leg.
        couplings: Couplings of the foot's lines with the board; None for none. Board `ad7746` has none.
    """
    beside = effects.couplings
    if board == "fdc1004_columns":
        elements = None
        if beside is not None and couplings is not None:
            elements = BesideElements(couplings, beside.idle_inputs, beside.shield_error_rel)
        columns_of = partial(_column_converter, foot, effects, seed, elements)
        return LegElectronics(tuple(columns_of(column) for column in range(ROWS)), ())
    rows = SimulatedLineSwitch(adg715.ADDRESS)
    if board == "fdc1004":
        of_columns = None
        if beside is not None and couplings is not None:
            of_columns = BesideColumns(couplings, beside.idle_inputs, beside.shield_error_rel)
        pins = _column_pin_capacitance(foot, rows, effects.stray_pf, of_columns)
        return LegElectronics((_fdc1004(pins, effects, seed),), (rows,))
    random = np.random.default_rng(seed)
    noise = random if effects.converter_noise else None
    common_noise = None
    if noise is not None and effects.common_noise_rel:
        common_noise = np.random.default_rng((*seed, _COMMON_NOISE_DRAW))
    clock_error_rel = effects.converter_clock_rel * random.uniform(-1, 1)
    columns = SimulatedLineSwitch(adg715.COLUMN_ADDRESS)
    error_k = np.random.default_rng((*seed, _THERMOMETER_DRAW)).uniform(-1, 1) * MAX_TEMPERATURE_ERROR_K
    warming = effects.warming
    converter = SimulatedAd7746(
        _mutual_capacitance(foot, rows, columns),
        noise,
        clock_error_rel,
        capdac_gain_rel=np.random.default_rng((*seed, _CAPDAC_DRAW)).uniform(*CAPDAC_GAIN_RANGE_REL),
        temperature_c=lambda t_ns: (
            ROOM_TEMPERATURE_C + error_k + (warming.temperature_change_k_at(t_ns) if warming else 0.0)
        ),
    )
    if common_noise is not None:
        converter.share_noise(effects.common_noise_rel, common_noise)
    return LegElectronics((converter,), (rows, columns))


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
    foot: WiredFoot, effects: Effects, seed: tuple[int, int], beside: BesideElements | None, column: int
) -> SimulatedFdc1004:
    """Return the fault-free converter of a column of board `fdc1004_columns`, of its own kind."""
    stream = (_COLUMN_DRAW, column) if column else ()
    pins = _element_pin_capacitance(foot, column, effects.stray_pf, beside)
    chip = _fdc1004(pins, effects, (*seed, *stream))
    odd = effects.odd_column
    if odd is not None and odd.column == column:
        chip.clock_factor += odd.slower_rel
        chip.trigger_clears_done = odd.trigger_clears_done
        chip.done_needs_both_reads = odd.done_needs_both_reads
    if beside is not None:
        phases = np.random.default_rng((*seed, _PHASE_DRAW, column))
        chip.excitations = Excitations(phases, chip.clock_factor)
        beside.chips.append(chip.excitations)
    return chip


def _element_pin_capacitance(
    foot: WiredFoot, column: int, stray_pf: float, beside: BesideElements | None
) -> MeanCinCapacitance:
    """Return the capacitance function of a converter of board `fdc1004_columns`: a pin for each row of its column."""

    def pin_pf(cin: int, t_start_ns: int, t_end_ns: int) -> float:
        t_ns, row = (t_start_ns + t_end_ns) // 2, cin
        added_pf, disturbances = 0.0, foot.disturbances
        if disturbances is not None:
            row = disturbances.column_of_pin(cin, t_ns)  # of this board the pins are rows
            added_pf = disturbances.added_pf(1 << row, column, t_start_ns, t_end_ns)
        if row >= ROWS:  # a pin without a line
            return added_pf + OPEN_ELEMENT_PF
        element, element_pf = row * ROWS + column, foot.elements_pf(t_ns)
        pin_pf = foot.element_pin_pf(element, element_pf[element] + stray_pf, t_ns)
        if beside is not None and pin_pf != OPEN_ELEMENT_PF:
            pin_pf += beside.added_pf(row, column, element_pf)
        return added_pf + pin_pf

    return pin_pf


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


def _mutual_capacitance(
    foot: WiredFoot, rows: SimulatedLineSwitch, columns: SimulatedLineSwitch
) -> MeanMutualCapacitance:
    """Return the mutual-capacitance function of board `ad7746`, between excited rows and selected columns."""

    def mutual_pf(t_start_ns: int, t_end_ns: int) -> tuple[float, bool]:
        t_ns = (t_start_ns + t_end_ns) // 2
        element_pf = foot.elements_pf(t_ns)
        total_pf, shorted, until_ns = 0.0, False, t_end_ns
        if foot.disturbances is not None:
            row_mask, column_mask = (
                switch.states_between(t_start_ns, t_end_ns)[0][1].selected_mask for switch in (rows, columns)
            )
            total_pf = foot.disturbances.added_pf(
                row_mask, column_mask.bit_length() - 1, t_start_ns, t_end_ns
            )
        for row_share, row_states in rows.states_between(t_start_ns, t_end_ns):
            since_ns = max(row_states.since_ns, t_start_ns)
            for column_share, column_states in columns.states_between(since_ns, until_ns):
                pf, to_ground = foot.mutual_pf(element_pf, row_states, column_states, t_ns)
                total_pf += row_share * column_share * pf
                shorted |= to_ground
            until_ns = since_ns
        return total_pf, shorted

    return mutual_pf
