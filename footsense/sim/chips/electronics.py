"""The boards of a leg: a converter, its line switches, and what the converter sees of the foot through them."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from firmware_interface import adg715
from footsense.sim.chips.ad7746 import CAPDAC_GAIN_REL, TEMPERATURE_ERROR_K, SimulatedAd7746
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.chips.line_switch import LineStates, SimulatedLineSwitch
from footsense.sim.faults.damage import Damage, mutual_capacitance_pf, pin_capacitance_pf
from footsense.sim.scene import Effects

#: Temperature of a scene that does not change it [deg C].
ROOM_C = 25.0

_COLUMNS = 3
#: Which of a leg's random numbers are whose: noise first, for it has the leg's own.
_CAPDAC_DRAW, _THERMOMETER_DRAW = 4, 5


class Wired(NamedTuple):
    """What the electronics are wired to.

    Attributes:
        elements_pf: Capacitance of its elements at a time [ns], nine, stray not included [pF].
        damage: What breaks in it; None for nothing.
    """

    elements_pf: Callable[[int], list[float]]
    damage: Damage | None


class Electronics(NamedTuple):
    """The chips of a leg as they are when nothing breaks.

    Attributes:
        converter: Its converter.
        switches: Its line switches.
    """

    converter: SimulatedFdc1004 | SimulatedAd7746
    switches: tuple[SimulatedLineSwitch, ...]


def electronics(board: str, foot: Wired, effects: Effects, seed: tuple[int, int]) -> Electronics:
    """Return the chips of one leg.

    Args:
        board: `fdc1004` or `ad7746`.
        foot: What they are wired to.
        effects: What is not ideal.
        seed: Of the scene and of the leg.
    """
    random = np.random.default_rng(seed)
    noise = random if effects.converter_noise else None
    clock_error_rel = effects.converter_clock_rel * random.uniform(-1, 1)
    rows = SimulatedLineSwitch(adg715.ADDRESS)
    if board == "fdc1004":
        return Electronics(
            SimulatedFdc1004(_ColumnPins(foot, rows, effects.stray_pf), noise, clock_error_rel), (rows,)
        )
    columns = SimulatedLineSwitch(adg715.COLUMN_ADDRESS)
    error_k = np.random.default_rng((*seed, _THERMOMETER_DRAW)).uniform(-1, 1) * TEMPERATURE_ERROR_K
    warming = effects.warming
    return Electronics(
        SimulatedAd7746(
            _Crossings(foot, rows, columns),
            noise,
            clock_error_rel,
            capdac_gain_rel=np.random.default_rng((*seed, _CAPDAC_DRAW)).uniform(*CAPDAC_GAIN_REL),
            temperature_c=lambda t_ns: ROOM_C + error_k + (warming.kelvin_at(t_ns) if warming else 0.0),
        ),
        (rows, columns),
    )


class _ColumnPins:
    """What a pin of board `fdc1004` sees: the elements of its column to ground through their rows, and stray."""

    def __init__(self, foot: Wired, rows: SimulatedLineSwitch, stray_pf: float) -> None:
        self._foot = foot
        self._rows = rows
        self._stray_pf = stray_pf

    def __call__(self, cin: int, t_start_ns: int, t_end_ns: int) -> float:
        """Return the mean capacitance of a pin to ground during a conversion [pF].

        The load is taken at the middle of the conversion, the row switches as they were during it.
        """
        t_middle_ns = (t_start_ns + t_end_ns) // 2
        elements_pf, damage = self._foot
        column_pf = [pf + self._stray_pf for pf in elements_pf(t_middle_ns)[cin::_COLUMNS]]
        total_pf = 0.0
        for share, states in self._rows.between(t_start_ns, t_end_ns):
            if damage is not None:
                total_pf += share * damage.seen_pf(cin, column_pf, states, t_middle_ns)
            else:
                total_pf += share * pin_capacitance_pf(column_pf, states)
        return total_pf


class _Crossings:
    """What the input of board `ad7746` sees: elements between excited rows and selected columns; no stray to ground."""

    def __init__(self, foot: Wired, rows: SimulatedLineSwitch, columns: SimulatedLineSwitch) -> None:
        self._foot = foot
        self._rows = rows
        self._columns = columns

    def __call__(self, t_start_ns: int, t_end_ns: int) -> tuple[float, bool]:
        """Return the mean capacitance during a conversion [pF], and whether the excitation was shorted in it."""
        t_middle_ns = (t_start_ns + t_end_ns) // 2
        elements_pf, damage = self._foot
        element_pf = elements_pf(t_middle_ns)
        total_pf, shorted = 0.0, False
        for share, rows, columns in self._states(t_start_ns, t_end_ns):
            if damage is not None:
                pf, to_ground = damage.sensed(element_pf, rows, columns, t_middle_ns)
            else:
                pf, to_ground = mutual_capacitance_pf(element_pf, rows, columns)
            total_pf += share * pf
            shorted |= to_ground
        return total_pf, shorted

    def _states(self, t_start_ns: int, t_end_ns: int) -> Iterator[tuple[float, LineStates, LineStates]]:
        """Yield the states of rows and columns in a span of time, each with its share of it."""
        until_ns = t_end_ns
        for share, rows in self._rows.between(t_start_ns, t_end_ns):
            since_ns = max(rows.since_ns, t_start_ns)
            for part, columns in self._columns.between(since_ns, until_ns):
                yield share * part, rows, columns
            until_ns = since_ns
