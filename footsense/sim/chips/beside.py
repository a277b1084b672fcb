"""What the conversions of a leg see beside their elements, from the state of its chips.

During a conversion a FDC1004 drives the converted input and its shield with the excitation. What it does with its other
inputs the data sheet (SNOSCY5) does not say, nor does a thread of the maker's forum that was found: the scene sets it.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from firmware_interface.chips.ad7147 import InputConnection
from footsense.frames import ELEMENTS, ROWS, Vector
from footsense.sim.chips.chip import LineStates
from footsense.sim.couplings import BoardCouplings, Couplings, InputState, converted_pf, potential_of

if TYPE_CHECKING:
    from footsense.sim.chips.excitation import Excitations


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


class BesideElements:
    """What the pins of board `fdc1004_columns` see beside their elements.

    Args:
        couplings: Couplings of the foot's lines.
        idle_inputs: What a converter does with the inputs that it does not convert.
        shield_error_rel: By how much its shield falls short of its excitation [1].

    Attributes:
        chips: Excitations of the converters, that of column 0 first.
    """

    def __init__(self, couplings: BoardCouplings, idle_inputs: InputState, shield_error_rel: float) -> None:
        self.chips: list[Excitations] = []
        self._mutual_pf = couplings.mutual_pf
        self._idle = potential_of(idle_inputs, shield_error_rel)
        self._shield = 1.0 - shield_error_rel
        self._elements = np.array(couplings.places(ELEMENT_NAMES)).reshape(ROWS, ROWS)
        self._shields = couplings.places([f"shld{column + 1}" for column in range(ROWS)])

    def added_pf(self, row: int, column: int, element_pf: Sequence[float]) -> float:
        """Return what the last conversion of a column's converter, of one row, finds beside its element [pF].

        Args:
            row: The row.
            column: The column.
            element_pf: Capacitance of each element [pF].
        """
        own = self.chips[column].recent[-1]
        overlaps = [
            (other, each.cin, own.correlation(each))
            for other, chip in enumerate(self.chips)
            if other != column
            for each in chip.recent
        ]
        return self.overlapped_pf(row, column, element_pf, overlaps)

    def overlapped_pf(
        self,
        row: int,
        column: int,
        element_pf: Sequence[float],
        overlaps: Sequence[tuple[int, int, float]] = (),
    ) -> float:
        """Return what a conversion that overlaps with others finds beside its element [pF].

        Args:
            row: The row.
            column: The column.
            element_pf: Capacitance of each element [pF].
            overlaps: Column and row of each other conversion, and the mean product of both excitations [1].
        """
        elements, floats = self._elements, math.isnan(self._idle)
        potential: Vector = np.zeros(len(self._mutual_pf))
        potential[elements if floats else elements[:, column]] = self._idle
        potential[self._shields[column]] = self._shield
        for other, converted, share in overlaps:
            if share == 0.0:
                continue
            potential[self._shields[other]] += share * self._shield
            for line, place in enumerate(elements[:, other]):
                if line == converted:
                    potential[place] = np.nan_to_num(potential[place]) + share
                elif not floats:
                    potential[place] += share * self._idle
        mutual_pf = self._mutual_pf
        if floats:  # the elements hold floating lines near ground
            mutual_pf = mutual_pf.copy()
            mutual_pf[elements.ravel(), -1] += element_pf
            mutual_pf[elements[row, column], -1] -= element_pf[row * ROWS + column]
        return converted_pf(mutual_pf, int(elements[row, column]), potential)


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
        board: `fdc1004`, `fdc1004_columns` or `ad7147`.
        couplings: Couplings of the foot's lines with it.
        settings: As of the scene.
        unloaded_pf: Capacitance of an unloaded element [pF].
    """
    element_pf, states = [unloaded_pf] * ELEMENTS, (settings.idle_inputs, settings.shield_error_rel)
    places = [divmod(element, ROWS) for element in range(ELEMENTS)]
    if board == "fdc1004":
        columns = BesideColumns(couplings, *states)
        all_rows = (1 << ROWS) - 1
        return [
            columns.added_pf(column, element_pf, LineStates(0, 1 << row, all_rows ^ 1 << row))
            for row, column in places
        ]
    if board == "ad7147":
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
    elements = BesideElements(couplings, *states)
    return [elements.overlapped_pf(row, column, element_pf) for row, column in places]
