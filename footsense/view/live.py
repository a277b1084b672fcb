"""Live data source of the page: reads the running service's ring, also after its restarts."""

from collections import deque
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from footsense.daemon.recording_header import CLOSURE_CONVERSION_KEY, ClosureConversion
from footsense.errors import FootsenseError
from footsense.frames import ELEMENTS, CanStatistics, Cycle
from footsense.ports import Clock
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.records import LostCycles
from footsense.view.closures import ClosureConverter
from footsense.view.events import Event, EventDetector
from footsense.view.signals import SignalTableBuilder, Table

#: Cycles that are kept for viewers [1]: a browser that comes back gets these, and no backlog.
_MAX_KEPT_CYCLES = 512
_MAX_KEPT_EVENTS = 200
#: Period of looking for a new service, and whether the present one lives [ns].
_SERVICE_CHECK_PERIOD_NS = 250_000_000


class ViewedCycle(NamedTuple):
    """One live cycle with its number, time, and table of signals.

    Attributes:
        number: Its number since this process began.
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
        clock: The machine's clock.

    Attributes:
        service: Number of the service that is followed; 0 before the first, one more with each restart.
        header: Header of its cycles; empty before the first.
        legs: Names of its legs.
        cycles: The last cycles, oldest first.
        events: Its last events, oldest first, each with its number since this process began.
        n_missed: Cycles that were overwritten before they were read.
        problem: Why no cycles come; empty while they do.
        can: Counts of its CAN channel.
    """

    def __init__(self, path: Path | None, clock: Clock) -> None:
        self._path = path
        self._clock = clock
        self._reader: CycleReader | None = None
        self._look_ns = 0
        self._n = self._n_events = 0
        self._first_ns = 0
        self.service = 0
        self.header: dict[str, str] = {}
        self.legs: tuple[str, ...] = ()
        self.cycles: deque[ViewedCycle] = deque(maxlen=_MAX_KEPT_CYCLES)
        self.events: deque[tuple[int, Event]] = deque(maxlen=_MAX_KEPT_EVENTS)
        self.n_missed = 0
        self.problem = ""
        self.can = CanStatistics()

    def poll(self) -> None:
        """Read the new cycles; without a service, look for one from time to time."""
        now_ns = self._clock.now_ns()
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + _SERVICE_CHECK_PERIOD_NS
            self._find_service()
        if self._reader is None:
            return
        try:
            entries = self._reader.read()
        except FootsenseError as error:
            self.problem = str(error)
            self._close()
            return
        status = self._reader.status
        unknown_pf = np.full((len(self.legs), ELEMENTS), np.nan)
        baseline_pf = unknown_pf if status is None else status.baseline_pf
        for entry in entries:
            if isinstance(entry, LostCycles):
                self.n_missed += entry.n_cycles
                continue
            cycle = entry.cycle
            if not self._first_ns:
                self._first_ns = cycle.forces.t_sent_ns
            table = self._table.table(cycle, self._closures.closure_rel(cycle, baseline_pf))
            t_s = (cycle.forces.t_sent_ns - self._first_ns) * 1e-9
            self.cycles.append(ViewedCycle(self._n, t_s, cycle, table))
            self._n += 1
            for event in self._log.new_events(cycle):
                self.events.append((self._n_events, event))
                self._n_events += 1

    def event_time_s(self, event: Event) -> float:
        """Return the time of an event on the time axis of the cycles [s]."""
        return (event.t_ns - self._first_ns) * 1e-9

    def _find_service(self) -> None:
        """Open the ring of a service; notice if the service has ended."""
        if self._reader is not None and self._reader.is_still_written():
            if self._reader.status is not None:
                self.can = self._reader.status.can
            return
        ended = self._reader is not None
        self._close()
        try:
            reader = CycleReader(self._path)
            elements = msgspec.json.decode(reader.header[CLOSURE_CONVERSION_KEY], type=ClosureConversion)
        except (KeyError, msgspec.MsgspecError) as error:
            self.problem = f"{reader.path}: its header is of another version of footsense ({error})"
            return
        except FootsenseError as error:
            self.problem = "the service has ended" if ended or self.service else f"no service runs: {error}"
            return
        self._reader = reader
        self._closures = ClosureConverter(elements)
        self._table = SignalTableBuilder(len(reader.legs))
        self._log = EventDetector(len(reader.legs))
        self.header, self.legs = reader.header, reader.legs
        self.cycles.clear()
        self.events.clear()
        self._first_ns, self.n_missed, self.problem = 0, 0, ""
        self.service += 1

    def _close(self) -> None:
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def status(self) -> dict[str, Any]:
        """Return the status that the page shows beside the cycles, as JSON values."""
        can = self.can
        return {
            "problem": self.problem,
            "n_missed": self.n_missed,
            "can": {
                "sent": can.sent,
                "dropped": can.dropped,
                "bus_off": can.bus_off,
                "error_passive": can.error_passive,
            },
        }

    def close(self) -> None:
        """Close the ring."""
        self._close()
