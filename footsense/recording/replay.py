"""A recording as an iterable of its cycles."""

from collections.abc import Callable, Iterator
from pathlib import Path

from footsense.frames import Cycle
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
