"""Injected damage of a foot and of its row and column lines, as changed capacitances at the converter's inputs.

Board `fdc1004`: the pin of column j measures each element of its column against its row line. A row at ground counts in
full, one at the shield drops out, a floating one counts in series with its own small capacitance to ground. A short
ties the pin to the row line. A row at ground then exceeds any range. A row at the shield makes the pin read zero,
whichever row is selected, because the shield driver delivers the charge that the converter counts: one shorted element
disables the others of its column. That follows from the wiring and was not measured.

Board `ad7147`: each element has a pin, against one electrode that is at ground, so that no row has a line. A short ties
one pin to ground. A tail that tears where the lines of a column lie loses its three.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from footsense.foot.specimen import Specimen
from footsense.frames import ROWS
from footsense.sim.chips.chip import FLOATING_ROW_PF, LineStates
from footsense.sim.faults import scene_faults
from footsense.sim.faults.disturbances import Disturbances
from footsense.sim.faults.scene_faults import Schedule

#: Capacitance of an element without electrode, or of a column without line: a piece of trace [pF].
OPEN_ELEMENT_PF = 0.1

#: A capacitance to ground beyond any converter's range [pF].
SHORTED_ELEMENT_PF = 1e6

_ROW_OR_COLUMN_FAULT_TYPES = (scene_faults.BrokenColumn, scene_faults.BrokenRow, scene_faults.ElementShorted)


class WiredFoot:
    """A foot with its row and column lines as the converter measures it, with damage to either.

    Args:
        undamaged_pf: Returns the capacitance of each element without damage at a time [ns], stray not included [pF].
        faults: Faults on this foot.
        foot: The foot.
        disturbances: What is added to its readings; None for nothing.

    Attributes:
        disturbances: As given.
    """

    def __init__(
        self,
        undamaged_pf: Callable[[int], list[float]],
        faults: Sequence[scene_faults.FootDamage],
        foot: Specimen,
        disturbances: Disturbances | None = None,
    ) -> None:
        self.disturbances = disturbances
        self._undamaged_pf = undamaged_pf
        self._on_lines = Schedule(
            (fault.span_ns, fault) for fault in faults if isinstance(fault, _ROW_OR_COLUMN_FAULT_TYPES)
        )
        self._on_elements = Schedule(
            # What has drifted stays.
            (
                (fault.at_ns, math.inf) if isinstance(fault, scene_faults.ElementDrifts) else fault.span_ns,
                fault,
            )
            for fault in faults
            if not isinstance(fault, _ROW_OR_COLUMN_FAULT_TYPES)
        )
        design = foot.response.design
        self._closed_pf = float(design.capacitance_pf(np.full(1, design.gap_um))[0])
        self._held_pf: dict[scene_faults.ElementStuck, float] = {}

    def elements_pf(self, t_ns: int) -> list[float]:
        """Return each element's capacitance at a time [ns], with damage, without the scene's `stray_pf` [pF]."""
        undamaged_pf = self._undamaged_pf(t_ns)
        acting = self._on_elements.at(t_ns)
        if not acting:
            return undamaged_pf
        damaged_pf = undamaged_pf.copy()
        for fault in acting:
            pf = damaged_pf[fault.element]
            match fault:
                case scene_faults.ElementDrifts():
                    drift_s = (min(t_ns, fault.until_ns) - fault.at_ns) * 1e-9
                    pf = max(pf + fault.rate_ff_per_s * drift_s * 1e-3, OPEN_ELEMENT_PF)
                case scene_faults.ElementStuck():
                    pf = self._held_pf.setdefault(fault, pf)
                case scene_faults.ElementOpen():
                    pf = OPEN_ELEMENT_PF
                case scene_faults.GapClosed():
                    pf = self._closed_pf
            damaged_pf[fault.element] = pf
        return damaged_pf

    def pin_pf(self, cin: int, column_pf: list[float], states: LineStates, t_ns: int) -> float:
        """Return the capacitance of pin `cin` to ground at a time [pF], with damage; see `pin_capacitance_pf`."""
        broken_rows, broken_columns, shorted = self._line_damage(t_ns)
        if broken_columns >> cin & 1:
            return OPEN_ELEMENT_PF
        shorted_rows = sum({1 << element // ROWS for element in shorted if element % ROWS == cin})
        return pin_capacitance_pf(column_pf, states, broken_rows, shorted_rows)

    def element_pin_pf(self, element: int, pf: float, t_ns: int) -> float:
        """Return the capacitance to ground of the pin of an element [pF], with damage to its lines.

        Args:
            element: Its flat index.
            pf: Capacitance to its row, stray included [pF].
            t_ns: Time [ns].
        """
        _, broken_columns, shorted = self._line_damage(t_ns)
        if broken_columns >> element % ROWS & 1:
            return OPEN_ELEMENT_PF
        return SHORTED_ELEMENT_PF if element in shorted else pf

    def _line_damage(self, t_ns: int) -> tuple[int, int, list[int]]:
        """Return the interrupted row lines and column lines at a time (bit masks), and the shorted elements."""
        rows = columns = 0
        shorted: list[int] = []
        for fault in self._on_lines.at(t_ns):
            match fault:
                case scene_faults.BrokenRow(row=row):
                    rows |= 1 << row
                case scene_faults.BrokenColumn(column=column):
                    columns |= 1 << column
                case scene_faults.ElementShorted(element=element):
                    shorted.append(element)
        return rows, columns, shorted


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
