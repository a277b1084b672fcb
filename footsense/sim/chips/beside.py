"""What the conversions of a leg see beside their elements, from the state of its chips.

During a conversion a FDC1004 drives the converted input and its shield with the excitation. What it does with its other
inputs the data sheet (SNOSCY5) does not say, nor does a thread of the maker's forum that was found: the scene sets it.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from firmware_interface.chips.ad7147 import InputConnection
from footsense.frames import ELEMENTS, ROWS
from footsense.sim.chips.chip import LineStates
from footsense.sim.couplings import BoardCouplings, Couplings, InputState, converted_pf, potential_of

#: Conductors of a table that are lines of single elements, by flat index.
ELEMENT_NAMES = [f"row{row + 1}col{column + 1}" for row in range(ROWS) for column in range(ROWS)]


class BesideColumns:
    """What the pins of board `fdc1004` see beside the elements that its row switch selects.

    Args:
        couplings: Couplings of the foot's lines.
        idle_inputs: What the converter does with the other columns.
        shield_error_rel: By how much its shield falls short of its excitation [1].
    """

    def __init__(self, couplings: BoardCouplings, idle_inputs: InputState, shield_error_rel: float) -> None:
        self._mutual_pf = couplings.mutual_pf
        self._columns = couplings.places([f"col{line + 1}" for line in range(ROWS)])
        self._rows = couplings.places([f"row{line + 1}" for line in range(ROWS)])
        self._shield = 1.0 - shield_error_rel
        self._potential = np.zeros(len(self._mutual_pf))
        self._potential[couplings.places(["shld"])] = self._shield
        self._potential[self._columns] = potential_of(idle_inputs, shield_error_rel)

    def added_pf(self, cin: int, element_pf: Sequence[float], rows: LineStates) -> float:
        """Return what a conversion of a column finds beside its selected elements [pF].

        Args:
            cin: The column.
            element_pf: Capacitance of each element [pF].
            rows: The rows' states. Those that float are left to the model of the elements, as if at the shield.
        """
        mutual_pf, potential = self._mutual_pf.copy(), self._potential.copy()
        mutual_pf[np.ix_(self._rows, self._columns)] += np.reshape(element_pf, (ROWS, ROWS))
        mutual_pf[np.ix_(self._columns, self._rows)] += np.reshape(element_pf, (ROWS, ROWS)).T
        selected_pf = 0.0
        for row, place in enumerate(self._rows):
            if rows.selected_mask >> row & 1:
                selected_pf += element_pf[row * ROWS + cin]
            else:
                potential[place] = self._shield if rows.unselected_mask >> row & 1 else 1.0
        return converted_pf(mutual_pf, self._columns[cin], potential) - selected_pf


class BesideInputs:
    """What the inputs of board `ad7147` see beside their elements.

    Args:
        couplings: Couplings of the foot's lines.
        shield_error_rel: By how much ACSHIELD and the bias of idle inputs fall short of the excitation [1].
    """

    def __init__(self, couplings: BoardCouplings, shield_error_rel: float) -> None:
        self._mutual_pf = couplings.mutual_pf
        self._elements = np.array(couplings.places(ELEMENT_NAMES))
        self._shield = 1.0 - shield_error_rel
        self._potential = np.zeros(len(self._mutual_pf))
        self._potential[couplings.places(["acshield"])] = self._shield
        self._fixed_pf = dict[tuple[int, tuple[InputConnection, ...]], float]()

    def added_pf(
        self, element: int, element_pf: Sequence[float], connections: tuple[InputConnection, ...]
    ) -> float:
        """Return what a conversion of an element finds beside it [pF].

        Args:
            element: Its flat index, and that of its input.
            element_pf: Capacitance of each element [pF].
            connections: What each input is tied to.
        """
        if (fixed_pf := self._fixed_pf.get((element, connections))) is not None:
            return fixed_pf
        potential, mutual_pf = self._potential.copy(), self._mutual_pf
        potential[self._elements] = [
            math.nan if each is InputConnection.FLOATING else self._shield for each in connections[:ELEMENTS]
        ]
        floats = InputConnection.FLOATING in connections[:ELEMENTS]
        if floats:  # the elements hold floating lines near ground
            mutual_pf = mutual_pf.copy()
            mutual_pf[self._elements, -1] += element_pf
            mutual_pf[self._elements[element], -1] -= element_pf[element]
        found_pf = converted_pf(mutual_pf, int(self._elements[element]), potential)
        if not floats:  # whatever the elements have
            self._fixed_pf[element, connections] = found_pf
        return found_pf


def unloaded_stray_pf(
    board: str, couplings: BoardCouplings, settings: Couplings, unloaded_pf: float
) -> list[float]:
    """Return what each element of an unloaded foot reads beside its own capacitance, on average [pF].

    Args:
        board: `fdc1004` or `ad7147`.
        couplings: Couplings of the foot's lines with it.
        settings: As of the scene.
        unloaded_pf: Capacitance of an unloaded element [pF].
    """
    element_pf = [unloaded_pf] * ELEMENTS
    if board == "fdc1004":
        columns = BesideColumns(couplings, settings.idle_inputs, settings.shield_error_rel)
        all_rows = (1 << ROWS) - 1
        return [
            columns.added_pf(column, element_pf, LineStates(0, 1 << row, all_rows ^ 1 << row))
            for row, column in itertools.product(range(ROWS), repeat=2)
        ]
    inputs = BesideInputs(couplings, settings.shield_error_rel)
    return [
        inputs.added_pf(
            element,
            element_pf,
            tuple(
                InputConnection.CDC_POSITIVE if cin == element else InputConnection.BIAS
                for cin in range(ELEMENTS)
            ),
        )
        for element in range(ELEMENTS)
    ]
