"""Recording as data source of the page: read once, stored as compressed seconds in a temporary file."""

import math
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np
import zstandard
from mcap.reader import make_reader

from footsense.config import Config
from footsense.daemon.models import load_models
from footsense.daemon.recording_header import (
    CLOSURE_CONVERSION_KEY,
    ClosureConversion,
    closure_conversion,
    recorded_config,
)
from footsense.errors import FootsenseError, RecordingError
from footsense.frames import ELEMENTS, Cycle
from footsense.recording.replay import Replay
from footsense.ring.records import LostCycles
from footsense.view.closures import ClosureConverter, ReconstructedBaselines
from footsense.view.events import Event, EventDetector
from footsense.view.page_messages import encode_cycles
from footsense.view.signals import SignalTableBuilder, Table

#: Events of a recording at most that a page is sent [1]: an hour of walking has 40 000.
_MAX_EVENTS = 100_000


class RecordingSource:
    """Recording as data source of the page, filled by `read`, which blocks: the caller runs it in a thread.

    Args:
        path: The recording.

    Attributes:
        path: The recording.
        header: Entries of its header.
        legs: Names of its legs.
        total_s: Length by its index [s]; 0 without an index.
        end_s: Length of the part that has been read [s].
        done: Whether all of it has been read.
        damage: Why it ends early, or what is unknown of it; empty if nothing.
        events: Its events with their times since its begin [s], as far as it has been read.

    Raises:
        RecordingError: The file is missing, or no recording.
    """

    def __init__(self, path: Path) -> None:
        self._replay = Replay(path)
        self.path = path
        self.header, self.legs = self._replay.header, self._replay.legs
        config = recorded_config(self._replay)
        self.damage = ""
        self._closures = ClosureConverter(self._closure_conversion(config))
        self._baselines = ReconstructedBaselines(self._closures.stray_pf, config.tare.window_scans)
        self._table = SignalTableBuilder(len(self.legs))
        self._log = EventDetector(len(self.legs))
        self.total_s = _recording_duration_s(path)
        self.end_s = 0.0
        self.done = False
        self.events: list[tuple[float, Event]] = []
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `close`
        self._lock = threading.Lock()
        self._places: list[tuple[int, int]] = []
        self._compressor = zstandard.ZstdCompressor(level=1)
        self._times_s: list[float] = []
        self._tables: list[Table] = []
        self._first_ns: int | None = None
        self._stopped = False

    def _closure_conversion(self, config: Config) -> ClosureConversion:
        """Return the closure parameters from the header, or from the models for old recordings."""
        if CLOSURE_CONVERSION_KEY in self.header:
            with suppress(msgspec.MsgspecError):
                return msgspec.json.decode(self.header[CLOSURE_CONVERSION_KEY], type=ClosureConversion)
        try:
            return closure_conversion(load_models(config))
        except FootsenseError as error:
            self.damage = f"the closures of the gaps are unknown: {error}"
            unknown = np.full((len(self.legs), ELEMENTS), np.nan)
            return ClosureConversion(np.zeros_like(unknown).tolist(), unknown.tolist())

    def read(self, on_progress: Callable[[float], None] = lambda _: None) -> None:
        """Read the recording to its end or first damage.

        Args:
            on_progress: Called with the length of the part that has been read [s], once a recorded second.
        """
        try:
            for entry in self._replay.entries():
                if self._stopped:
                    return
                if isinstance(entry, LostCycles):
                    self._add_event(
                        Event(
                            entry.next_t_sent_ns, None, "loss", "fault", f"{entry.n_cycles} cycles were lost"
                        )
                    )
                else:
                    self._add_cycle(entry.cycle, on_progress)
        except RecordingError as error:
            self.damage = str(error)
        self._store_second()
        self.done = True
        on_progress(self.end_s)

    def _add_cycle(self, cycle: Cycle, on_progress: Callable[[float], None]) -> None:
        if self._first_ns is None:
            self._first_ns = cycle.forces.t_sent_ns
        t_s = (cycle.forces.t_sent_ns - self._first_ns) * 1e-9
        while math.floor(t_s) > len(self._places) and not self._stopped:
            self._store_second()
            on_progress(self.end_s)
        baseline_pf = self._baselines.baseline_pf_after(cycle)
        self._times_s.append(t_s)
        self._tables.append(self._table.table(cycle, self._closures.closure_rel(cycle, baseline_pf)))
        self.end_s = t_s
        for event in self._log.new_events(cycle):
            self._add_event(event)

    def _add_event(self, event: Event) -> None:
        if len(self.events) < _MAX_EVENTS:
            self.events.append(((event.t_ns - (self._first_ns or event.t_ns)) * 1e-9, event))

    def _store_second(self) -> None:
        packed = self._compressor.compress(encode_cycles(1 + len(self._places), self._times_s, self._tables))
        with self._lock:
            if self._stopped:
                return
            place = self._file.seek(0, 2)
            self._file.write(packed)
        self._places.append((place, len(packed)))
        self._times_s, self._tables = [], []

    def encoded_second(self, number: int) -> bytes:
        """Return one second of the recording as a binary message; empty if there is none."""
        if not 0 <= number < len(self._places):
            return b""
        place, length = self._places[number]
        with self._lock:
            self._file.seek(place)
            packed = self._file.read(length)
        return zstandard.ZstdDecompressor().decompress(packed)

    @property
    def n_seconds(self) -> int:
        """Number of seconds of the recording read so far."""
        return len(self._places)

    def close(self) -> None:
        """Stop reading, and delete the temporary file."""
        with self._lock:
            self._stopped = True
            self._file.close()


def _recording_duration_s(path: Path) -> float:
    """Return the duration of a recording from its MCAP index [s]; 0 for a truncated one without index."""
    try:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
    except Exception:  # noqa: BLE001 - the library raises many kinds for damaged bytes; reading names the damage
        return 0.0
    if summary is None or summary.statistics is None:
        return 0.0
    length_ns = int(summary.statistics.message_end_time) - int(summary.statistics.message_start_time)
    return max(0.0, length_ns * 1e-9)
