"""A recording as an iterable of its cycles."""

from collections.abc import Callable, Iterator
from pathlib import Path

from footsense.frames import Cycle
from footsense.recording.container.mcap_header import read_header
from footsense.recording.container.mcap_reader import read_entries
from footsense.recording.cycle_records import LostCycles, NumberedCycle


class Replay:
    """A recording; each iteration reads it from its beginning.

    Args:
        path: The recording, finished or not.
        on_read: Receives the number of bytes read so far.

    Attributes:
        path: The recording.
        header: Entries of its header.
        legs: Name of the leg in each row of the frames.

    Raises:
        RecordingError: The file is missing, or not a recording, or its header is damaged.
    """

    def __init__(self, path: Path, on_read: Callable[[int], None] = lambda _: None) -> None:
        self.path = path
        self._on_read = on_read
        self.header = read_header(path)
        self.legs = tuple(self.header["legs"].split(","))

    def entries(self) -> Iterator[NumberedCycle | LostCycles]:
        """Return complete cycles and recorded losses in file order.

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
