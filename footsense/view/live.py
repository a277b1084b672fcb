"""Live data source of the page: reads the running service's ring, also after its restarts."""

from collections import deque
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from footsense.daemon.recording_header import recorded_closure_conversion
from footsense.errors import FootsenseError
from footsense.frames import ELEMENTS, CanStatistics, Cycle
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.records import LostCycles
from footsense.view.events import EventLog
from footsense.view.signals import SignalTables, Table

#: Cycles that are kept for viewers [1]: a browser that comes back gets these, and no backlog.
_MAX_KEPT_CYCLES = 512
_MAX_KEPT_EVENTS = 200


class ViewedCycle(NamedTuple):
    """One live cycle with its number, time, and table of signals.

    Attributes:
        number: Its number since the service was found.
        t_s: Time since the first cycle of the service that was seen [s].
        cycle: The cycle.
        table: Its signals.
    """

    number: int
    t_s: float
    cycle: Cycle
    table: Table


class LiveSource:
    """Reads the ring of the running service, and keeps the latest cycles and events.

    Args:
        path: The service's ring; None for where it is by default.

    Attributes:
        service: Number of the service that is followed; 0 before the first, one more with each restart.
        legs: Names of its legs; empty before the first.
        events: Its last events.
        problem: Why no cycles come; empty while they do.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._reader: CycleReader | None = None
        self._scene: dict[str, Any] = {}
        self._can = CanStatistics()
        self._cycles: deque[ViewedCycle] = deque(maxlen=_MAX_KEPT_CYCLES)
        self._n = 0
        self.service = 0
        self.legs: tuple[str, ...] = ()
        self.events = EventLog((), 0)
        self.problem = ""

    def poll(self) -> None:
        """Read the new cycles; without a service, look for one."""
        if self._reader is None:
            self._find_service()
        if self._reader is None:
            return
        try:
            entries = self._reader.read()
        except FootsenseError as error:
            self.problem = str(error)
            self.close()
            return
        if not entries and not self._reader.is_still_written():
            self.problem = "the service has ended"
            self.close()
            return
        baseline_pf = np.full((len(self.legs), ELEMENTS), np.nan)
        if (status := self._reader.status) is not None:
            self._can, baseline_pf = status.can, status.baseline_pf
        for entry in entries:
            if isinstance(entry, LostCycles):
                continue
            cycle = entry.cycle
            t_s = self.events.time_s(cycle.forces.t_sent_ns)
            self._cycles.append(ViewedCycle(self._n, t_s, cycle, self._tables.table(cycle, baseline_pf)))
            self._n += 1
            self.events.add_cycle(cycle)

    def catch_up(self) -> None:
        """Read all that came while nobody looked, and go on with another service if that has ended."""
        place = None
        while place != (place := (self.service, self._n)):
            self.poll()
            if self._reader is None:
                self.poll()

    def _find_service(self) -> None:
        """Open the ring of a service, if one runs."""
        try:
            reader = CycleReader(self._path)
        except FootsenseError as error:
            self.problem = "the service has ended" if self.service else f"no service runs: {error}"
            return
        try:
            conversion = recorded_closure_conversion(reader.header, reader.legs)
            self._scene = msgspec.json.decode(reader.header.get("scene") or "{}", type=dict[str, Any])
        except (ValueError, RecursionError) as error:
            reader.close()
            self.problem = f"{reader.path}: its header is of another version of footsense ({error})"
            return
        self._reader, self.legs = reader, reader.legs
        self._tables = SignalTables(conversion)
        self.events = EventLog(self.legs, _MAX_KEPT_EVENTS)
        self._cycles.clear()
        self._n, self.problem = 0, ""
        self.service += 1

    def cycles_since(self, number: int, max_cycles: int) -> list[ViewedCycle]:
        """Return the kept cycles from a number on, the newest if there are more than `max_cycles`."""
        n_new = min(self._n - number, len(self._cycles), max_cycles)
        return list(islice(self._cycles, len(self._cycles) - n_new, None)) if n_new > 0 else []

    def description(self) -> dict[str, Any]:
        """Return what the page shows of the service, as JSON values."""
        title = "on the robot" if self.legs else "no service"
        if self._scene:
            title = self._scene.get("description", "")
        return {"mode": "live", "title": title, "legs": self.legs, "simulated": bool(self._scene)}

    def status(self) -> dict[str, Any]:
        """Return the status that the page shows beside the cycles, as JSON values."""
        return {"problem": self.problem, "can_sent": self._can.sent, "bus_off": self._can.bus_off}

    def close(self) -> None:
        """Close the ring."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None
