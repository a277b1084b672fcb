"""Recordings of faults: what a service's ring holds some seconds after a leg has got another cause.

What happened before a robot fell is in the ring for 30 s. A process beside the loop writes it to a file; what the file
costs, a full disk too, is that process's alone. Few files are kept, of each leg and cause the newest.
"""

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

from footsense.errors import FootsenseError
from footsense.frames import Cause, Cycle
from footsense.leg_words import word_of
from footsense.recording.snapshot import write_snapshot
from footsense.ring.cycle_reader import CycleReader

_log = logging.getLogger(__name__)

#: Time from a fault to its recording, of which 20 s are before it; and least time from one recording to the next [ns].
AFTER_NS, PERIOD_NS = 10_000_000_000, 60_000_000_000
#: Where the unit of `footsense snapshot` keeps them.
FAULT_FOLDER = Path("/var/lib/footsense/faults")
#: Most recordings that are kept of a leg and cause, and of all: some 100 MB of six legs.
MOST_ALIKE, MOST = 3, 20


class FaultRecorder:
    """Writes recordings of the faults of one service, as a `Follower` of its ring.

    Of the causes that come within the time between two recordings, the first counts.

    Args:
        reader: Reader of the ring.
        folder: Folder of the recordings, which is created.
        wall_time: Returns the time in UTC, ISO 8601, for their names.
    """

    def __init__(self, reader: CycleReader, folder: Path, wall_time: Callable[[], str]) -> None:
        self._reader, self._folder, self._wall_time = reader, folder, wall_time
        self._causes = [int(Cause.NONE)] * len(reader.legs)
        #: Leg and cause of the recording that is not written yet, such as `lf-element-drifts`; empty without one.
        self._reason = ""
        self._due_ns = self._next_ns = 0

    def add(self, cycles: Sequence[Cycle]) -> None:
        """Write what is due with the cycles since the last call."""
        for cycle in cycles:
            t_ns, causes = cycle.forces.t_sent_ns, cycle.forces.cause.tolist()
            if not self._reason and t_ns >= self._next_ns:
                for leg, old, new in zip(self._reader.legs, self._causes, causes, strict=True):
                    if new not in {old, Cause.NONE}:
                        self._reason = f"{leg}-{word_of(Cause(new)).replace(' ', '-')}"
                        self._due_ns, self._next_ns = t_ns + AFTER_NS, t_ns + PERIOD_NS
                        break
            self._causes = causes
            if t_ns >= self._due_ns:
                self.end()

    def end(self) -> None:
        """Write at once what is not due yet."""
        reason, self._reason = self._reason, ""
        if not reason:
            return
        target = self._folder / f"{self._wall_time().replace(':', '-')}-{reason}.mcap"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            write_snapshot(self._reader, target)
            self._remove_old(reason)
        except (FootsenseError, OSError) as error:
            _log.warning("%s is not recorded: %s", reason, error)
        else:
            _log.warning("%s: recorded in %s", reason, target)

    def _remove_old(self, reason: str) -> None:
        for pattern, n_kept in ((f"*Z-{reason}.mcap", MOST_ALIKE), ("*Z-*.mcap", MOST)):
            for old in sorted(self._folder.glob(pattern))[:-n_kept]:
                old.unlink(missing_ok=True)


def fault_recordings(folder: Path) -> list[Path]:
    """Return the recordings of faults in a folder, the newest first."""
    return sorted(folder.glob("*Z-*.mcap"), reverse=True)
