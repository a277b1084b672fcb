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

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from footsense.foot.specimen import Foot
from footsense.sim.chips.line_switch import FLOATING_ROW_PF, LineStates
from footsense.sim.faults.scene_faults import (
    BrokenColumn,
    BrokenRow,
    ElementDrifts,
    ElementOpen,
    ElementShorted,
    ElementStuck,
    GapShut,
    OnFoot,
)
from footsense.sim.faults.schedule import Schedule

#: What is left of an element without its electrode, or of a column without its line: a piece of trace [pF].
OPEN_PF = 0.1
#: A capacitance to ground beyond any converter's range [pF].
SHORT_PF = 1e6

_COLUMNS = 3
_ROWS = 3


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


class _Drift(NamedTuple):
    """An element that drifts from a time [ns] until another."""

    element: int
    rate_ff_per_s: float
    from_ns: float
    until_ns: float


class Damage:
    """All that breaks in one foot and on its lines.

    Args:
        faults: What, and when.
        foot: The foot.
    """

    def __init__(self, faults: Sequence[OnFoot], foot: Foot) -> None:
        self._on_lines = Schedule(
            (fault.span_ns, fault)
            for fault in faults
            if isinstance(fault, BrokenColumn | BrokenRow | ElementShorted)
        )
        # What has drifted stays where it was.
        self._on_elements = Schedule(
            ((fault.at_ns, math.inf), _Drift(fault.element, fault.rate_ff_per_s, *fault.span_ns))
            if isinstance(fault, ElementDrifts)
            else (fault.span_ns, fault)
            for fault in faults
            if isinstance(fault, ElementDrifts | ElementStuck | ElementOpen | GapShut)
        )
        design = foot.response.design
        self._shut_pf = float(design.capacitance_pf(np.full(1, design.gap_um))[0])
        self._held_pf: dict[ElementStuck, float] = {}

    def elements_pf(self, element_pf: list[float], t_ns: int) -> list[float]:
        """Return what the elements have at a time, nine, of what they would have if they were whole [pF]."""
        acting = self._on_elements.at(t_ns)
        if not acting:
            return element_pf
        element_pf = element_pf.copy()
        for fault in acting:
            whole_pf = element_pf[fault.element]
            match fault:
                case _Drift(_, rate_ff_per_s, from_ns, until_ns):
                    span_s = (min(t_ns, until_ns) - from_ns) * 1e-9
                    pf = max(whole_pf + rate_ff_per_s * span_s * 1e-3, OPEN_PF)
                case ElementStuck():
                    pf = self._held_pf.setdefault(fault, whole_pf)
                case ElementOpen():
                    pf = OPEN_PF
                case GapShut():
                    pf = self._shut_pf
            element_pf[fault.element] = pf
        return element_pf

    def seen_pf(self, cin: int, column_pf: list[float], states: LineStates, t_ns: int) -> float:
        """Return what pin `cin` sees of its column, three elements, through the row lines as they are [pF]."""
        broken_rows = shorted_rows = 0
        for fault in self._on_lines.at(t_ns):
            match fault:
                case BrokenColumn(column=column) if column == cin:
                    return OPEN_PF
                case BrokenRow(row=row):
                    broken_rows |= 1 << row
                case ElementShorted(element=element) if element % _COLUMNS == cin:
                    shorted_rows |= 1 << element // _COLUMNS
                case _:
                    pass
        return pin_capacitance_pf(column_pf, states, broken_rows, shorted_rows)

    def sensed(
        self, element_pf: list[float], rows: LineStates, columns: LineStates, t_ns: int
    ) -> tuple[float, bool]:
        """Return what the input of a board with excited rows sees at a time, as `mutual_capacitance_pf` does."""
        broken_rows = broken_columns = 0
        shorted: list[int] = []
        for fault in self._on_lines.at(t_ns):
            match fault:
                case BrokenColumn(column=column):
                    broken_columns |= 1 << column
                case BrokenRow(row=row):
                    broken_rows |= 1 << row
                case ElementShorted(element=element):
                    shorted.append(element)
        return mutual_capacitance_pf(element_pf, rows, columns, broken_rows, broken_columns, shorted)
