"""Signals of a cycle as one numeric table (legs by signals), which the page draws and plots."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, Cycle, GaitFrame, Vector

Table = NDArray[np.float32]

#: Age from which contact and ground are unknown [ns]: three of their periods, as a consumer of CAN has it.
_MAX_GAIT_AGE_NS = 300_000_000


class Signal(NamedTuple):
    """One signal of a leg (a column of the table): name and unit.

    Attributes:
        name: Its name, the same in JSON and on the page.
        unit: Its unit; empty for a ratio, a code or a mask.
    """

    name: str
    unit: str


#: The columns of the table in their order, before those of the elements' closures.
_FOOT_SIGNALS = (
    *(Signal("fx", "N"), Signal("fy", "N"), Signal("fz", "N")),
    *(Signal("sigma_x", "N"), Signal("sigma_y", "N"), Signal("sigma_z", "N")),
    Signal("age", "ms"),
    *(Signal("state", ""), Signal("cause", ""), Signal("fault_mask", ""), Signal("flags", "")),
    *(Signal("baseline_status", ""), Signal("baseline_mean", "fF"), Signal("baseline_worst", "fF")),
    Signal("temperature", "degC"),
    *(Signal("contact", ""), Signal("probability", ""), Signal("load_share", "")),
    *(Signal("normal_x", ""), Signal("normal_y", ""), Signal("normal_z", ""), Signal("normal_sigma", "rad")),
    *(
        Signal("tangential_over_normal", ""),
        Signal("tangential_over_normal_sigma", ""),
        Signal("friction", ""),
    ),
    *(Signal("slip", ""), Signal("all_in_air", "")),
    Signal("closure_middle", ""),
)
#: The columns of the signal table, in order; the closures of the elements come last.
SIGNALS = (*_FOOT_SIGNALS, *(Signal(f"closure_{element}", "") for element in range(ELEMENTS)))
_COLUMN_OF_SIGNAL = {signal.name: column for column, signal in enumerate(SIGNALS)}
_FORCE_SLICE = slice(_COLUMN_OF_SIGNAL["fx"], _COLUMN_OF_SIGNAL["fx"] + 3)
_SIGMA_SLICE = slice(_COLUMN_OF_SIGNAL["sigma_x"], _COLUMN_OF_SIGNAL["sigma_x"] + 3)
#: The columns of the closures.
CLOSURE_COLUMNS = slice(len(_FOOT_SIGNALS), None)
_NORMAL_SLICE = slice(_COLUMN_OF_SIGNAL["normal_x"], _COLUMN_OF_SIGNAL["normal_x"] + 3)

_CONTACT_FRAME_COLUMNS: tuple[tuple[int, Callable[[Any], Any]], ...] = (
    (_COLUMN_OF_SIGNAL["age"], lambda forces: np.where(forces.t_ns > 0, forces.age_ns * 1e-6, np.nan)),
    (_COLUMN_OF_SIGNAL["state"], lambda forces: forces.state),
    (_COLUMN_OF_SIGNAL["cause"], lambda forces: forces.cause),
    (_COLUMN_OF_SIGNAL["fault_mask"], lambda forces: forces.fault_mask),
    (_COLUMN_OF_SIGNAL["flags"], lambda forces: forces.flags),
    (_COLUMN_OF_SIGNAL["baseline_status"], lambda forces: forces.baseline.status),
    (_COLUMN_OF_SIGNAL["baseline_mean"], lambda forces: forces.baseline.mean_pf * 1e3),
    (_COLUMN_OF_SIGNAL["baseline_worst"], lambda forces: forces.baseline.worst_pf * 1e3),
)
_GAIT_COLUMNS = {
    _COLUMN_OF_SIGNAL["contact"]: "contact",
    _COLUMN_OF_SIGNAL["probability"]: "probability",
    _COLUMN_OF_SIGNAL["load_share"]: "load_share",
    _COLUMN_OF_SIGNAL["normal_sigma"]: "normal_sigma_rad",
    _COLUMN_OF_SIGNAL["tangential_over_normal"]: "tangential_over_normal",
    _COLUMN_OF_SIGNAL["tangential_over_normal_sigma"]: "tangential_over_normal_sigma",
    _COLUMN_OF_SIGNAL["friction"]: "friction",
    _COLUMN_OF_SIGNAL["slip"]: "slip",
    _COLUMN_OF_SIGNAL["all_in_air"]: "all_in_air",
}


class SignalTableBuilder:
    """Converts cycles to signal tables; keeps the last gait and temperature, which not every cycle has.

    Args:
        n_legs: Rows of the frames.
    """

    def __init__(self, n_legs: int) -> None:
        self._n_legs = n_legs
        self._gait: GaitFrame | None = None
        self._temperature_c = np.full(n_legs, np.nan)

    def table(self, cycle: Cycle, closure_rel: Vector) -> Table:
        """Return the signal table of the next cycle, shape (legs, signals); NaN where unknown.

        Args:
            cycle: The cycle.
            closure_rel: Closure of each gap over the gap [1], shape (legs, elements).
        """
        forces = cycle.forces
        if forces.gait is not None:
            self._gait = forces.gait
        if cycle.temperature_c is not None:
            self._temperature_c = cycle.temperature_c
        table = np.full((self._n_legs, len(SIGNALS)), np.nan, np.float32)
        table[:, _FORCE_SLICE] = forces.force_n
        table[:, _SIGMA_SLICE] = forces.sigma_n
        table[:, _COLUMN_OF_SIGNAL["closure_middle"]] = closure_rel[:, ELEMENTS // 2]
        table[:, CLOSURE_COLUMNS] = closure_rel
        for column, value in _CONTACT_FRAME_COLUMNS:
            table[:, column] = value(forces)
        table[:, _COLUMN_OF_SIGNAL["temperature"]] = self._temperature_c
        gait = self._gait
        if gait is not None and forces.t_sent_ns - gait.t_ns <= _MAX_GAIT_AGE_NS:
            table[:, _NORMAL_SLICE] = gait.normal
            for column, name in _GAIT_COLUMNS.items():
                table[:, column] = getattr(gait, name)
        return table
