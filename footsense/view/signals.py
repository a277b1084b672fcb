"""Signals of a cycle as one numeric table (legs by signals), which the page draws and plots."""

import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footsense.daemon.recording_header import ClosureConversion
from footsense.frames import ELEMENTS, ContactFrame, Cycle, GaitFrame, Vector
from footsense.ring.records import GAIT_FIELDS

Table = NDArray[np.float32]

#: Age from which contact and ground are unknown [ns]: three of their periods, as a consumer of CAN has it.
_MAX_GAIT_AGE_NS = 300_000_000
_CYCLES_HEADER_STRUCT = struct.Struct("<IIII")

#: Signals of every cycle: forces in N, age in ms, offsets of the baseline in fF.
_FRAME_SIGNALS: dict[str, Callable[[ContactFrame], Any]] = {
    "fx": lambda forces: forces.force_n[:, 0],
    "fy": lambda forces: forces.force_n[:, 1],
    "fz": lambda forces: forces.force_n[:, 2],
    "sigma_x": lambda forces: forces.sigma_n[:, 0],
    "sigma_y": lambda forces: forces.sigma_n[:, 1],
    "sigma_z": lambda forces: forces.sigma_n[:, 2],
    "contact_probability": lambda forces: forces.contact_probability,
    "holds": lambda forces: forces.holds,
    "age": lambda forces: np.where(forces.t_ns > 0, forces.age_ns * 1e-6, np.nan),
    "state": lambda forces: forces.state,
    "cause": lambda forces: forces.cause,
    "fault_mask": lambda forces: forces.fault_mask,
    "flags": lambda forces: forces.flags,
    "baseline_status": lambda forces: forces.baseline.status,
    "baseline_mean": lambda forces: forces.baseline.mean_pf * 1e3,
}
#: Signals of the last gait, by the names that they have there: all with one number for each leg, but for times.
_GAIT_SIGNALS = (
    "friction",
    *(
        name
        for path, field in GAIT_FIELDS.items()
        for name in field.json_keys
        if path.endswith(name) and field.dtype != "<i8"
    ),
)
#: The columns of the table: temperature in degrees Celsius; the closures of the elements over the gap come last.
SIGNALS = (
    *_FRAME_SIGNALS,
    *_GAIT_SIGNALS,
    "temperature",
    *(f"closure_{element}" for element in range(ELEMENTS)),
)
CLOSURE_COLUMNS = slice(-ELEMENTS, None)


class SignalTables:
    """Converts successive cycles to tables of signals; keeps the last gait and temperature, which not every cycle has.

    Args:
        conversion: Parameters of the elements.

    Attributes:
        stray_pf: Capacitance in parallel with each element [pF], shape (legs, elements).
    """

    def __init__(self, conversion: ClosureConversion) -> None:
        self.stray_pf = np.array(conversion.stray_pf)
        self._distance_times_capacitance_pf = np.array(conversion.distance_times_capacitance_pf)
        self._gait: GaitFrame | None = None
        self._temperature_c = np.full(len(self.stray_pf), np.nan)

    def table(self, cycle: Cycle, baseline_pf: Vector) -> Table:
        """Return the signal table of the next cycle, shape (legs, signals); NaN where unknown.

        Args:
            cycle: The cycle.
            baseline_pf: Unloaded reading of each element, without stray [pF], shape (legs, elements).
        """
        forces, gait = cycle.forces, cycle.forces.gait or self._gait
        self._gait = gait
        if cycle.temperature_c is not None:
            self._temperature_c = cycle.temperature_c
        table = np.full((len(self.stray_pf), len(SIGNALS)), np.nan, np.float32)
        for column, value in enumerate(_FRAME_SIGNALS.values()):
            table[:, column] = value(forces)
        if gait is not None and forces.t_sent_ns - gait.t_ns <= _MAX_GAIT_AGE_NS:
            for column, name in enumerate(_GAIT_SIGNALS, len(_FRAME_SIGNALS)):
                table[:, column] = getattr(gait, name)
        table[:, -ELEMENTS - 1] = self._temperature_c
        table[:, CLOSURE_COLUMNS] = self.closure_rel(cycle, baseline_pf)
        return table

    @np.errstate(divide="ignore", invalid="ignore")
    def closure_rel(self, cycle: Cycle, baseline_pf: Vector) -> Vector:
        """Return the closures over the gap [1], shape (legs, elements), as the estimation computes them.

        Args:
            cycle: The cycle with the readings.
            baseline_pf: Unloaded reading of each element, without stray [pF], shape (legs, elements).

        Returns:
            The closures; NaN without reading or baseline.
        """
        reading_pf = cycle.scan.capacitance_pf - self.stray_pf
        closure_rel: Vector = self._distance_times_capacitance_pf * (1.0 / baseline_pf - 1.0 / reading_pf)
        return closure_rel


def encode_cycles(kind: int, times_s: Sequence[float], tables: Sequence[Table]) -> bytes:
    """Return several cycles as one binary message to the page: header, times, tables.

    Four little-endian u32: `kind`, cycles, legs, signals; then the time of each cycle as float64; then the tables as
    float32.

    Args:
        kind: 0 for live cycles; 1 + number for a second of a recording.
        times_s: Time of each cycle [s].
        tables: Signals of each, shape (legs, signals).
    """
    n_legs, n_signals = tables[0].shape if tables else (0, 0)
    head = _CYCLES_HEADER_STRUCT.pack(kind, len(tables), n_legs, n_signals)
    return b"".join((head, np.array(times_s, "<f8").tobytes(), *(t.astype("<f4").tobytes() for t in tables)))
