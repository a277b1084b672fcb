"""Replay of a recording: iterable of its cycles, and frame source and clock for the main loop."""

from collections.abc import Callable, Iterator
from pathlib import Path

from footsense.errors import RecordingError
from footsense.frames import CapFrame, Command, Cycle
from footsense.recording.mcap_reader import read_entries, read_header
from footsense.ring.records import LostCycles, NumberedCycle


class Replay:
    """Iterable of a recording's cycles; each iteration reads the file from the beginning.

    Args:
        path: The recording, finished or not.
        on_bytes_read: Receives the number of bytes read so far; None for nobody.

    Attributes:
        path: The recording.
        header: Entries of its header.
        legs: Name of the leg in each row of the frames.

    Raises:
        RecordingError: The file is missing, or not a recording, or its header is damaged.
    """

    def __init__(self, path: Path, on_bytes_read: Callable[[int], None] | None = None) -> None:
        self.path = path
        self._on_read = on_bytes_read or (lambda _: None)
        self.header = read_header(path)
        self.legs = tuple(self.header["legs"].split(","))

    def entries(self) -> Iterator[NumberedCycle | LostCycles]:
        """Return an iterator over complete cycles and recorded losses, in file order.

        Returns:
            An iterator that reads the file as it goes.

        Raises:
            RecordingError: The rest of the file is cut off or damaged.
        """
        return read_entries(self.path, self.legs, self._on_read)

    def __iter__(self) -> Iterator[Cycle]:
        """Iterate over complete cycles in file order.

        Returns:
            An iterator that reads the file as it goes.

        Raises:
            RecordingError: The rest of the file is cut off or damaged.
        """
        return (entry.cycle for entry in self.entries() if isinstance(entry, NumberedCycle))


class ReplaySource:
    """Frame source that plays the capacitance frames of a recording.

    Args:
        replay: The recording.

    Attributes:
        cycle: The recorded cycle of the last frame; None before the first.
        lost: Cycles missing in the recording before that one; states after a loss may differ from the recorded ones.
        damage: The error that ended the recording early; None without one.
    """

    def __init__(self, replay: Replay) -> None:
        self._entries = replay.entries()
        self._commands: tuple[Command, ...] = ()
        self.cycle: Cycle | None = None
        self.lost = 0
        self.damage: RecordingError | None = None

    def read(self) -> CapFrame | None:
        """Return the next capacitance frame; None at the end or at damage (see `damage`)."""
        try:
            for entry in self._entries:
                if isinstance(entry, NumberedCycle):
                    self.cycle = entry.cycle
                    self._commands = self.cycle.started_commands
                    return self.cycle.scan
                self.lost += entry.n_cycles
        except RecordingError as error:
            self.damage = error
        return None

    def commands(self) -> list[Command]:
        """Return the commands that were executed in the cycle of the last frame; a second call returns none."""
        commands, self._commands = list(self._commands), ()
        return commands

    def close(self) -> None:
        """Do nothing: the file is closed when its iterator ends."""


class ReplayClock:
    """Clock that shows the recorded sending time of the current cycle, and never waits.

    Args:
        source: Source of the current cycle.
    """

    def __init__(self, source: ReplaySource) -> None:
        self._source = source

    def now_ns(self) -> int:
        """Return the recorded sending time of the current cycle [ns]; 0 before the first cycle."""
        return self._source.cycle.forces.t_sent_ns if self._source.cycle else 0

    def sleep_until_ns(self, t_ns: int) -> None:
        """Return at once, as a replay runs as fast as possible."""
