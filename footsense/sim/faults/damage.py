"""Damage of a foot and of the lines to it, in the capacitances that a converter measures.

Board `fdc1004`: the pin of column j measures each element of its column against its row line. A row at ground counts in
full, one at the shield drops out, a floating one counts in series with its own small capacitance to ground. A short
ties the pin to the row line. A row at ground then exceeds any range. A row at the shield makes the pin read zero,
whichever row is selected, because the shield driver delivers the charge that the converter counts: one shorted element
disables the two others of its column. That follows from the wiring and was not measured.

Board `ad7746`: the input measures each element between an excited row and a selected column; all other lines are at
ground, so that a broken line disables its own elements only. A short ties a row to a column. With both selected it
exceeds any range; with the row selected it shorts the excitation; with the column selected it grounds the input, which
reads zero. Not simulated: coupling through two floating lines at once.
"""

import math
from collections.abc import Sequence

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
    GapClosed,
    OnFoot,
)
from footsense.sim.faults.schedule import Schedule

#: Capacitance of an element without electrode, or of a column without line: a piece of trace [pF].
OPEN_PF = 0.1
#: A capacitance to ground beyond any converter's range [pF].
SHORT_PF = 1e6

_COLUMNS = 3
_ROWS = 3


def pin_capacitance_pf(
    column_pf: Sequence[float], states: LineStates, broken_rows: int = 0, shorted_rows: int = 0
) -> float:
    """Return the capacitance of a pin of board `fdc1004` to ground [pF].

    Args:
        column_pf: Capacitance of each element of its column [pF], three.
        states: Rows that the switch ties to ground (selected) and to the shield (waiting).
        broken_rows: Bit r for each row line that is interrupted.
        shorted_rows: Bit r for each row to which the column is shorted.
    """
    # A short is on the foot's side of a broken line: the row floats with the pin.
    broken = broken_rows & ~shorted_rows
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
    """Return the capacitance between excitation and input of board `ad7746`, and whether the excitation is shorted.

    Args:
        element_pf: Capacitance of each element [pF], nine.
        rows: Rows that the switch ties to the excitation (selected) and to ground (waiting).
        columns: Columns that the switch ties to the input (selected) and to ground (waiting).
        broken_rows: Bit r for each row line that is interrupted.
        broken_columns: Bit c for each column line that is interrupted.
        shorted: Elements whose electrodes touch.

    Returns:
        Capacitance [pF], and whether a short ties the excitation to ground.
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
    """Faults of one foot and of its lines.

    Args:
        faults: Faults on this foot.
        foot: The foot.
    """

    def __init__(self, faults: Sequence[OnFoot], foot: Foot) -> None:
        on_lines = [fault for fault in faults if isinstance(fault, BrokenColumn | BrokenRow | ElementShorted)]
        self._on_lines = Schedule((fault.span_ns, fault) for fault in on_lines)
        self._on_elements = Schedule(
            # What has drifted stays.
            ((fault.at_ns, math.inf) if isinstance(fault, ElementDrifts) else fault.span_ns, fault)
            for fault in faults
            if not isinstance(fault, BrokenColumn | BrokenRow | ElementShorted)
        )
        design = foot.response.design
        self._closed_pf = float(design.capacitance_pf(np.full(1, design.gap_um))[0])
        self._held_pf: dict[ElementStuck, float] = {}

    def elements_pf(self, whole_pf: list[float], t_ns: int) -> list[float]:
        """Return the capacitance of each element of the damaged foot at a time [pF], nine.

        Args:
            whole_pf: Capacitance of each element of the whole foot [pF], nine.
            t_ns: The time [ns].
        """
        acting = self._on_elements.at(t_ns)
        if not acting:
            return whole_pf
        damaged_pf = whole_pf.copy()
        for fault in acting:
            pf = damaged_pf[fault.element]
            match fault:
                case ElementDrifts():
                    drift_s = (min(t_ns, fault.until_ns) - fault.at_ns) * 1e-9
                    pf = max(pf + fault.rate_ff_per_s * drift_s * 1e-3, OPEN_PF)
                case ElementStuck():
                    pf = self._held_pf.setdefault(fault, pf)
                case ElementOpen():
                    pf = OPEN_PF
                case GapClosed():
                    pf = self._closed_pf
            damaged_pf[fault.element] = pf
        return damaged_pf

    def pin_pf(self, cin: int, column_pf: list[float], states: LineStates, t_ns: int) -> float:
        """Return the capacitance to ground of pin `cin` at a time [pF]; arguments as of `pin_capacitance_pf`."""
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

    def mutual_pf(
        self, element_pf: list[float], rows: LineStates, columns: LineStates, t_ns: int
    ) -> tuple[float, bool]:
        """Return mutual capacitance [pF] and short at a time, as `mutual_capacitance_pf` with its arguments."""
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
