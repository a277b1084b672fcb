"""Signals of a recording for its plot, collected in 120 bytes per cycle of six legs."""

from typing import NamedTuple

import numpy as np

from footsense.errors import RecordingError
from footsense.frames import USABLE, Codes, Cycle, GaitEvent, Mask, Vector
from footsense.recording.replay import Replay

_NS_PER_S = 1e9


class PlotSignals(NamedTuple):
    """Signals of a recording for its plot; times in seconds since the first cycle.

    Attributes:
        t_s: Time of sending of each cycle, shape (cycles,).
        along_leg_n: Force along each leg [N], shape (cycles, legs); NaN unless usable.
        across_leg_n: Force across it [N], the same.
        along_leg_sigma_n: Standard deviation of the force along it [N], the same.
        state: State of each leg, shape (cycles, legs).
        contact_t_s: Time of each gait, shape (gaits,).
        contact: Debounced contact of each leg, shape (gaits, legs).
        events: Gait events; their times are in `event_t_s`.
        event_t_s: Time of each event.
    """

    t_s: Vector
    along_leg_n: Vector
    across_leg_n: Vector
    along_leg_sigma_n: Vector
    state: Codes
    contact_t_s: Vector
    contact: Mask
    events: list[GaitEvent]
    event_t_s: list[float]


class _SignalCollector:
    """Collects the plotted signals cycle by cycle."""

    def __init__(self, legs: tuple[str, ...]) -> None:
        self._n_legs = len(legs)
        self._first_ns: int | None = None
        self._t_s, self._forces, self._states = bytearray(), bytearray(), bytearray()
        self._contact_t_s, self._contacts = bytearray(), bytearray()
        self._events: list[GaitEvent] = []
        self._event_t_s: list[float] = []

    def add(self, cycle: Cycle) -> None:
        """Append the signals of one cycle."""
        forces, gait = cycle.forces, cycle.forces.gait
        if self._first_ns is None:
            self._first_ns = forces.t_sent_ns
        t_s = (forces.t_sent_ns - self._first_ns) / _NS_PER_S
        usable = np.isin(forces.state, list(USABLE))[:, None]
        x, y, z = forces.force_n.T
        values = np.stack([z, np.hypot(x, y), forces.sigma_n[:, 2]], axis=1)
        self._t_s += np.float64(t_s).tobytes()
        self._forces += np.where(usable, values, np.nan).astype(np.float32).tobytes()
        self._states += forces.state.tobytes()
        if gait is not None:
            self._contact_t_s += np.float64(t_s).tobytes()
            self._contacts += (gait.contact & usable[:, 0]).tobytes()
            self._events += gait.events
            self._event_t_s += [(event.t_ns - self._first_ns) / _NS_PER_S for event in gait.events]

    def signals(self) -> PlotSignals:
        """Return the collected signals as arrays."""
        n_legs = self._n_legs
        forces = np.frombuffer(self._forces, np.float32).reshape(-1, n_legs, 3).astype(np.float64)
        return PlotSignals(
            np.frombuffer(self._t_s, np.float64),
            forces[:, :, 0],
            forces[:, :, 1],
            forces[:, :, 2],
            np.frombuffer(self._states, np.uint8).reshape(-1, n_legs),
            np.frombuffer(self._contact_t_s, np.float64),
            np.frombuffer(self._contacts, np.bool_).reshape(-1, n_legs),
            self._events,
            self._event_t_s,
        )


def collect_signals(replay: Replay) -> tuple[PlotSignals, RecordingError | None]:
    """Return the plotted signals of a recording, and the error that ended it early, if any."""
    collection = _SignalCollector(replay.legs)
    damage = None
    try:
        for cycle in replay:
            collection.add(cycle)
    except RecordingError as error:
        damage = error
    return collection.signals(), damage
