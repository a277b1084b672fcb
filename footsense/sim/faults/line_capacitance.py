"""Capacitances at the converter's inputs, given the elements and the (broken or shorted) row and column lines.

Board `fdc1004`: the pin of column j measures each element of its column against its row line. A row at ground counts in
full, one at the shield drops out, a floating one counts in series with its own small capacitance to ground. A short
ties the pin to the row line. A row at ground then exceeds any range. A row at the shield makes the pin read zero,
whichever row is selected, because the shield driver delivers the charge that the converter counts: one shorted element
disables the others of its column. That follows from the wiring and was not measured.

Board `ad7746`: the input measures each element between an excited row and a selected column; all other lines are at
ground, so that a broken line disables its own elements only. A short ties a row to a column. With both selected it
exceeds any range; with the row selected it shorts the excitation; with the column selected it grounds the input, which
reads zero. Not simulated: coupling through two floating lines at once.
"""

from collections.abc import Sequence

from footsense.frames import ROWS
from footsense.sim.chips.line_switch import FLOATING_ROW_PF, LineStates

#: A capacitance to ground beyond any converter's range [pF].
SHORTED_ELEMENT_PF = 1e6


def pin_capacitance_pf(
    column_pf: Sequence[float], states: LineStates, broken_rows: int = 0, shorted_rows: int = 0
) -> float:
    """Return the capacitance to ground of one converter pin of board `fdc1004` [pF].

    Args:
        column_pf: Capacitance of each element of its column [pF], one a row.
        states: Rows that the switch ties to ground (selected) and to the shield (unselected).
        broken_rows: Bit r for each row line that is interrupted.
        shorted_rows: Bit r for each row to which the column is shorted.
    """
    # A short is on the foot's side of a broken line: the row floats with the pin.
    broken = broken_rows & ~shorted_rows
    if shorted_rows & states.selected_mask & ~broken_rows:
        return SHORTED_ELEMENT_PF
    if shorted_rows & states.unselected_mask & ~broken_rows:
        return 0.0
    total_pf = 0.0
    for row, pf in enumerate(column_pf):
        bit = 1 << row
        if shorted_rows & bit:
            total_pf += FLOATING_ROW_PF
        elif broken & bit or not (states.selected_mask | states.unselected_mask) & bit:
            total_pf += pf * FLOATING_ROW_PF / (pf + FLOATING_ROW_PF)
        elif states.selected_mask & bit:
            total_pf += pf
    return total_pf


def mutual_capacitance_pf(
    element_pf: Sequence[float],
    rows: LineStates,
    columns: LineStates,
    broken_rows: int,
    broken_columns: int,
    shorted: Sequence[int],
) -> tuple[float, bool]:
    """Return the capacitance from excitation to input of board `ad7746` [pF], and whether it is shorted.

    Args:
        element_pf: Capacitance of each element [pF], a square array.
        rows: Rows that the switch ties to the excitation (selected) and to ground (unselected).
        columns: Columns that the switch ties to the input (selected) and to ground (unselected).
        broken_rows: Bit r for each row line that is interrupted.
        broken_columns: Bit c for each column line that is interrupted.
        shorted: Elements whose electrodes touch.

    Returns:
        Capacitance [pF], and whether a short ties the excitation to ground.
    """
    excited, earthed = rows.selected_mask & ~broken_rows, rows.unselected_mask & ~broken_rows
    sensed, idle = columns.selected_mask & ~broken_columns, columns.unselected_mask & ~broken_columns
    total_pf, to_ground, over = 0.0, False, False
    for element in shorted:
        row, column = divmod(element, ROWS)
        over |= bool(excited >> row & sensed >> column & 1)
        to_ground |= bool(excited >> row & idle >> column & 1)
        if earthed >> row & sensed >> column & 1:
            return 0.0, to_ground
    for element, pf in enumerate(element_pf):
        row, column = divmod(element, ROWS)
        if excited >> row & sensed >> column & 1:
            total_pf += pf
    return (SHORTED_ELEMENT_PF if over else total_pf), to_ground
