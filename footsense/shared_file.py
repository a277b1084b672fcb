"""Memory-mapped file that one process writes and others read, such as the service's counters.

The writer holds an exclusive flock(2) on it for as long as it lives, so that a file without a lock is left over from a
process that was killed. Readers see the file only once it is complete: it is written under another name, and renamed.
"""

import contextlib
import fcntl
import mmap
import os
import tempfile
from pathlib import Path
from typing import BinaryIO

from footsense.errors import FootsenseError


class SharedFileWriter:
    """Writer's end of a memory-mapped file: creates it, locks it, and removes it when closed.

    Args:
        path: The file. It should lie in memory (/dev/shm, /run): on a disk, write-back can block the writer.
        head: Its first bytes.
        n_bytes: Bytes behind the head, initially zero.

    Attributes:
        cells: The bytes behind the head.

    Raises:
        FootsenseError: Another running process writes this file, or it cannot be created.
    """

    def __init__(self, path: Path, head: bytes, n_bytes: int) -> None:
        self._path = path
        self._fd, unnamed = -1, path
        try:
            with contextlib.suppress(FileNotFoundError), path.open("rb") as present:
                if is_locked(present):
                    raise FootsenseError(f"{path}: another running service writes this file")
            self._fd, name = tempfile.mkstemp(prefix=f"{path.name}.", dir=path.parent)
            unnamed = Path(name)
            fcntl.flock(self._fd, fcntl.LOCK_EX)
            os.fchmod(self._fd, 0o644)
            os.write(self._fd, head)
            os.ftruncate(self._fd, len(head) + n_bytes)
            self.cells = memoryview(mmap.mmap(self._fd, 0))[len(head) :]
            unnamed.rename(path)
        except OSError as error:
            if self._fd >= 0:
                os.close(self._fd)
                unnamed.unlink()
            raise FootsenseError(f"{path}: cannot be written: {error.strerror}") from error

    def close(self) -> None:
        """Remove the file and release its lock; a second call does nothing."""
        if self._fd >= 0:
            self._path.unlink(missing_ok=True)
            os.close(self._fd)
            self._fd = -1
            self.cells.release()


def is_locked(file: BinaryIO) -> bool:
    """Return whether the writer's lock of an open file is held by another process or file object."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    fcntl.flock(file, fcntl.LOCK_UN)
    return False
