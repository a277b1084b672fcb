"""Recording as data source of the page: read once, stored as compressed seconds in a temporary file."""

import math
import os
import tempfile
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import zstandard

from footsense.daemon.recording_header import ClosureConversion, recorded_closure_conversion, recorded_config
from footsense.errors import RecordingError
from footsense.frames import ELEMENTS, CommandKind, Cycle, Result, Vector
from footsense.recording.replay import Replay
from footsense.ring.records import LostCycles
from footsense.view.events import EventLog
from footsense.view.signals import SignalTables, Table, encode_cycles

#: Events of a recording at most that a page is sent [1]: an hour of walking has 40 000.
_MAX_EVENTS = 100_000


class RecordingSource:
    """Recording as data source of the page, filled by `read`, which blocks: the caller runs it in a thread.

    Args:
        path: The recording.

    Attributes:
        service: Number of the service that is shown, as of `LiveSource`: it never changes.
        path: The recording.
        events: Its events, as far as it has been read.

    Raises:
        RecordingError: The file is missing, or no recording.
    """

    service = 1

    def __init__(self, path: Path) -> None:
        self._replay = Replay(path)
        self.path = path
        self._damage = ""
        self._tables = SignalTables(self._closure_conversion())
        window_scans = recorded_config(self._replay).tare.window_scans
        self._baselines = ReconstructedBaselines(self._tables.stray_pf, window_scans)
        self._end_s = 0.0
        self._done = False
        self.events = EventLog(self._replay.legs, _MAX_EVENTS)
        # Without a buffer: one thread writes, another reads.
        self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - goes with the source
        #: Place and length of each second that has cycles, by its number.
        self._places: dict[int, tuple[int, int]] = {}
        self._number = 0
        self._second: list[tuple[float, Table]] = []

    def _closure_conversion(self) -> ClosureConversion:
        """Return the closure parameters from the header."""
        try:
            return recorded_closure_conversion(self._replay.header, self._replay.legs)
        except ValueError as error:
            self._damage = f"the closures of the gaps are unknown, by the header: {error}"
            unknown = np.full((len(self._replay.legs), ELEMENTS), np.nan).tolist()
            return ClosureConversion(unknown, unknown)

    def read(self, on_bytes_read: Callable[[int], None] | None = None) -> None:
        """Read the recording to its end or first damage; `on_bytes_read` is as that of `Replay`."""
        try:
            for entry in Replay(self.path, on_bytes_read).entries():
                if isinstance(entry, LostCycles):
                    text = f"{entry.n_cycles} cycles were lost"
                    self.events.add(entry.next_t_sent_ns, None, "loss", "fault", text)
                else:
                    self._add_cycle(entry.cycle)
        except RecordingError as error:
            self._damage = str(error)
        self._store_second()
        self._done = True

    def _add_cycle(self, cycle: Cycle) -> None:
        t_s = self.events.time_s(cycle.forces.t_sent_ns)
        if math.floor(t_s) > self._number:
            self._store_second()
            self._number = math.floor(t_s)
        self._second.append((t_s, self._tables.table(cycle, self._baselines.baseline_pf_after(cycle))))
        self._end_s = t_s
        self.events.add_cycle(cycle)

    def _store_second(self) -> None:
        times_s, tables = [t_s for t_s, _ in self._second], [table for _, table in self._second]
        packed = zstandard.compress(encode_cycles(1 + self._number, times_s, tables), level=1)
        place = self._file.tell()
        self._file.write(packed)
        self._places[self._number] = place, len(packed)
        self._second = []

    def encoded_second(self, number: int) -> list[bytes]:
        """Return the binary message of one second of the recording; an empty list if there is no such second."""
        if number not in self._places:  # a gap, or not read yet
            return [encode_cycles(1 + number, [], [])] if 0 <= number < self._number else []
        place, length = self._places[number]
        return [zstandard.decompress(os.pread(self._file.fileno(), length, place))]

    def description(self) -> dict[str, Any]:
        """Return what the page shows of the recording, as JSON values."""
        simulated = bool(self._replay.header.get("scene"))
        return {"mode": "replay", "title": self.path.name, "legs": self._replay.legs, "simulated": simulated}

    def status(self) -> dict[str, Any]:
        """Return how much has been read, as JSON values."""
        return {
            "problem": self._damage,
            "end": self._end_s if self._done else float(self._number),
            "done": self._done,
        }

    def close(self) -> None:
        """Delete the temporary file, once `read` has ended; the end of the process does it too."""
        self._file.close()


class ReconstructedBaselines:
    """Baselines of a recording, reconstructed from tares and mean drift, as recordings do not contain them.

    A tare is the mean of the scans before its result. Drift tracking moves the elements of a leg nearly alike: its
    mean is added to each.

    Args:
        stray_pf: Capacitance in parallel with each element [pF], shape (legs, elements).
        window_scans: Scans that a tare averages.
    """

    def __init__(self, stray_pf: Vector, window_scans: int) -> None:
        self._stray_pf = stray_pf
        self._tared_pf = np.full(stray_pf.shape, np.nan)
        self._windows = [deque[Vector](maxlen=window_scans) for _ in stray_pf]
        self._newest_ns = [0] * len(stray_pf)

    def baseline_pf_after(self, cycle: Cycle) -> Vector:
        """Return the baselines after the next cycle, without stray [pF], shape (legs, elements).

        Returns:
            The baselines, shape (legs, elements), NaN before the first tare.
        """
        scan = cycle.scan
        oldest, newest = scan.t_ns.min(axis=1).tolist(), scan.t_ns.max(axis=1).tolist()
        for leg, window in enumerate(self._windows):
            if oldest[leg] > self._newest_ns[leg]:  # every element has been read anew
                self._newest_ns[leg] = newest[leg]
                window.append(scan.capacitance_pf[leg] - self._stray_pf[leg])
        for outcome in cycle.ended_commands:
            if outcome.command.kind is CommandKind.TARE and outcome.result is Result.DONE:
                leg = outcome.command.leg
                self._tared_pf[leg] = np.mean(self._windows[leg], axis=0)
        drift_pf = np.nan_to_num(cycle.forces.baseline.mean_pf)
        return self._tared_pf + drift_pf[:, None]
