"""Injected damage of a foot and of its row and column lines, as changed capacitances at the converter."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from footsense.foot.specimen import Foot
from footsense.frames import ROWS
from footsense.sim.chips.line_switch import LineStates
from footsense.sim.faults import scene_faults
from footsense.sim.faults.line_capacitance import mutual_capacitance_pf, pin_capacitance_pf
from footsense.sim.faults.schedule import Schedule

#: Capacitance of an element without electrode, or of a column without line: a piece of trace [pF].
OPEN_ELEMENT_PF = 0.1

_ROW_OR_COLUMN_FAULT_TYPES = (scene_faults.BrokenColumn, scene_faults.BrokenRow, scene_faults.ElementShorted)


class WiredFoot:
    """A foot with its row and column lines as the converter measures it, with damage to either.

    Args:
        undamaged_pf: Returns the capacitance of each element without damage at a time [ns], stray not included [pF].
        faults: Faults on this foot.
        foot: The foot.
    """

    def __init__(
        self,
        undamaged_pf: Callable[[int], list[float]],
        faults: Sequence[scene_faults.FootDamage],
        foot: Foot,
    ) -> None:
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

    def mutual_pf(
        self, element_pf: list[float], rows: LineStates, columns: LineStates, t_ns: int
    ) -> tuple[float, bool]:
        """Return mutual capacitance [pF] and whether it is shorted, with damage; see `mutual_capacitance_pf`."""
        return mutual_capacitance_pf(element_pf, rows, columns, *self._line_damage(t_ns))

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
