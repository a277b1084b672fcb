"""What is broken in a foot and on the lines to it, as a converter sees it.

On board `fdc1004`, the pin of column j sees each element of its column to its row line, and what that line is tied to:
ground counts in full, the shield drops out, nothing at all leaves the line's own small capacitance to ground in series.

A short ties the pin itself to the row line. To ground, that is beyond any range. To the shield, the shield driver
delivers the charge that the converter should count, so that nothing is read whichever row is selected: one shorted
element takes the two others of its column along. That follows from the wiring and was not measured.

On board `ad7746`, the input sees each element between an excited row and a selected column; all other lines are at
ground, so that one that is interrupted takes nothing but its own elements along. A short ties a row to a column: both
selected, that is beyond any range; the row alone, the excitation is shorted; the column alone, the input is, and reads
nothing. Not simulated: what couples through two floating lines at once.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from footsense.sim.fabricated import Foot
from footsense.sim.faults import (
    BrokenColumn,
    BrokenRow,
    ElementDrifts,
    ElementOpen,
    ElementShorted,
    ElementStuck,
    GapShut,
    OnFoot,
)
from footsense.sim.line_switch import FLOATING_ROW_PF, LineStates

#: What is left of an element without its electrode, or of a column without its line: a piece of trace [pF].
OPEN_PF = 0.1
#: A capacitance to ground beyond any converter's range [pF].
SHORT_PF = 1e6

_COLUMNS = 3
_ROWS = 3

Vector = NDArray[np.float64]


def pin_capacitance_pf(
    column_pf: Sequence[float], states: LineStates, broken_rows: int = 0, shorted_rows: int = 0
) -> float:
    """Return what a pin sees of its column [pF].

    Args:
        column_pf: Capacitance of each element of the column, shape (3,).
        states: What the row switch ties to ground and to the shield.
        broken_rows: Bit r for each row line that is interrupted.
        shorted_rows: Bit r for each row to which the column is shorted.
    """
    broken = (
        broken_rows & ~shorted_rows
    )  # a short is on the foot's side of a broken line: the row floats with the pin
    if shorted_rows & states.selected & ~broken_rows:
        return SHORT_PF
    if shorted_rows & states.waiting & ~broken_rows:
        return 0.0
    total_pf = 0.0
    for row in range(_ROWS):
        bit = 1 << row
        pf = column_pf[row]
        if shorted_rows & bit:
            total_pf += FLOATING_ROW_PF
        elif broken & bit or not (states.selected | states.waiting) & bit:
            total_pf += pf * FLOATING_ROW_PF / (pf + FLOATING_ROW_PF)
        elif states.selected & bit:
            total_pf += pf
    return total_pf


def mutual_capacitance_pf(
    element_pf: Sequence[float],
    rows: LineStates,
    columns: LineStates,
    broken_rows: int = 0,
    broken_columns: int = 0,
    shorted: Sequence[int] = (),
) -> tuple[float, bool]:
    """Return what an input sees of the excitation through the elements [pF], and whether that is shorted to ground.

    Args:
        element_pf: Capacitance of each element, shape (9,).
        rows: What the row switch ties to the excitation and to ground.
        columns: What the column switch ties to the input and to ground.
        broken_rows: Bit r for each row line that is interrupted.
        broken_columns: Bit c for each column line that is interrupted.
        shorted: Elements whose electrodes touch.
    """
    excited, earthed = rows.selected & ~broken_rows, rows.waiting & ~broken_rows
    sensed, idle = columns.selected & ~broken_columns, columns.waiting & ~broken_columns
    total_pf, to_ground, over = 0.0, False, False
    for element in shorted:
        row, column = divmod(element, _COLUMNS)
        over |= bool(excited >> row & sensed >> column & 1)
        to_ground |= bool(excited >> row & idle >> column & 1)
        if earthed >> row & sensed >> column & 1:
            return 0.0, to_ground
    for element, pf in enumerate(element_pf):
        row, column = divmod(element, _COLUMNS)
        if excited >> row & sensed >> column & 1:
            total_pf += pf
    return (SHORT_PF if over else total_pf), to_ground


class Damage:
    """All that breaks in one foot and on its lines.

    Args:
        faults: What, and when.
        foot: The foot.
    """

    def __init__(self, faults: Sequence[OnFoot], foot: Foot) -> None:
        self._faults = tuple(faults)
        self._foot = foot
        design = foot.response.design
        self._shut_pf = float(design.capacitance_pf(np.full(1, design.gap_um))[0])
        self._held_pf: dict[ElementStuck, float] = {}

    def elements_pf(self, element_pf: Vector, t_ns: int) -> Vector:
        """Return what the elements have at a time, shape (9,), of what they would have if they were whole [pF]."""
        element_pf = element_pf.copy()
        for fault in self._faults:
            if fault.at_ns > t_ns:
                continue
            over = t_ns >= fault.span_ns[1]
            match fault:
                case ElementDrifts():
                    span_s = (min(t_ns, fault.span_ns[1]) - fault.at_ns) * 1e-9
                    drifted_pf = element_pf[fault.element] + fault.rate_ff_per_s * span_s * 1e-3
                    element_pf[fault.element] = max(drifted_pf, OPEN_PF)
                case ElementStuck() if not over:
                    held_pf = self._held_pf.setdefault(fault, float(element_pf[fault.element]))
                    element_pf[fault.element] = held_pf
                case ElementOpen() if not over:
                    element_pf[fault.element] = OPEN_PF
                case GapShut() if not over:
                    element_pf[fault.element] = self._shut_pf
                case _:
                    pass
        return element_pf

    def seen_pf(self, cin: int, column_pf: Vector, states: LineStates, t_ns: int) -> float:
        """Return what pin `cin` sees of its column, shape (3,), through the row lines as they are at a time [pF]."""
        broken_rows = shorted_rows = 0
        for fault in self._faults:
            if not fault.span_ns[0] <= t_ns < fault.span_ns[1]:
                continue
            match fault:
                case BrokenColumn(column=column) if column == cin:
                    return OPEN_PF
                case BrokenRow(row=row):
                    broken_rows |= 1 << row
                case ElementShorted(element=element) if element % _COLUMNS == cin:
                    shorted_rows |= 1 << element // _COLUMNS
                case _:
                    pass
        return pin_capacitance_pf(column_pf.tolist(), states, broken_rows, shorted_rows)

    def sensed(
        self, element_pf: Vector, rows: LineStates, columns: LineStates, t_ns: int
    ) -> tuple[float, bool]:
        """Return what the input of a board with excited rows sees at a time, as `mutual_capacitance_pf` does."""
        broken_rows = broken_columns = 0
        shorted: list[int] = []
        for fault in self._faults:
            if not fault.span_ns[0] <= t_ns < fault.span_ns[1]:
                continue
            match fault:
                case BrokenColumn(column=column):
                    broken_columns |= 1 << column
                case BrokenRow(row=row):
                    broken_rows |= 1 << row
                case ElementShorted(element=element):
                    shorted.append(element)
                case _:
                    pass
        return mutual_capacitance_pf(element_pf.tolist(), rows, columns, broken_rows, broken_columns, shorted)
