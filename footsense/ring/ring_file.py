"""Ring of records in one file in memory, which one process writes and others read; none of them waits.

The file::

    8 bytes   "FSRING03"
    4 x 8     end, begin, recent, length n of the header: unsigned, in the byte order of this machine
    n bytes   the header: JSON
    zeros     to the end of a page
    the rest  the ring: the byte at position p, counted since the start, lies at p modulo its size

`end` is the position behind the last record. `begin` is the oldest position that can still be read; it is moved on
before the bytes ahead of it are overwritten, and so stands at the beginning of a block of records. `recent` is where
the last block begins. A record is its length, never 0, and its CRC-32 (4 bytes each), then its bytes. The CRC starts
from the record's position modulo 2^32. The counters are stored and loaded as aligned words, so that no reader sees half
of one. A reader copies first and looks at `begin` again afterwards: what was overwritten meanwhile is dropped.

Some processors (ARM) let a reader see the stores for one record in any order. At the place of the newest record it may
still find zeros, or a record of the lap before, whose CRC started elsewhere and so differs for certain. What is not
whole therefore counts as not written yet until another record follows it. `begin` may be seen after bytes that it gave
up; the margin behind the newest record covers that.

The records are written with pwrite(2) and read with pread(2): only the first page is mapped, and the ring takes no
memory of any process. The writer holds an exclusive flock(2) on the file for as long as it lives, so that a file
without a lock is left over from a process that was killed.
"""

import contextlib
import fcntl
import mmap
import os
import stat
import struct
from pathlib import Path

from footsense.errors import FootsenseError
from footsense.regular_file import open_regular

MAGIC = b"FSRING03"
#: How the ring of every version begins.
_MAGIC_OF_ALL = MAGIC[:6]
#: Places of the counters, in words of 8 bytes.
END, BEGIN, RECENT, HEADER_BYTES = range(1, 5)
HEADER_PLACE = 40
RECORD_HEAD = struct.Struct("<II")
#: Longest record [bytes], far above any cycle.
MAX_RECORD_BYTES = 1 << 19
#: Bytes between the newest record and the oldest that can be read: more than are written before `begin` is seen.
MARGIN_BYTES = 1 << 16
#: The ring of a robot's service: in the directory that its unit makes.
SERVICE_RING = Path("/run/footsense/ring")


def ring_place(n_header: int) -> int:
    """Return where the ring begins in the file [bytes], behind a header of some length."""
    return -(-(HEADER_PLACE + n_header) // mmap.PAGESIZE) * mmap.PAGESIZE


def default_ring(*, is_simulated: bool) -> Path:
    """Return the path of a service's ring: that of the robot, if its unit has made the directory, or of this user."""
    if not is_simulated and os.access(SERVICE_RING.parent, os.W_OK):
        return SERVICE_RING
    return user_ring()


def user_ring() -> Path:
    """Return the path of the ring of a simulated robot: in memory, and this user's own."""
    return Path(os.environ.get("XDG_RUNTIME_DIR", "/dev/shm"), f"footsense-{os.geteuid()}.ring")  # noqa: S108


def free_ring(path: Path) -> Path:
    """Return a path, or another one beside it if a running service writes that file."""
    try:
        os.close(open_ring(path))
    except FootsenseError:
        return path
    return path.with_name(f"{path.name}.{os.getpid()}")


def open_ring(path: Path) -> int:
    """Return a descriptor of the ring of a running service, without waiting for anything.

    Raises:
        FootsenseError: There is none, its service has ended, or something else has its name.
    """
    fd = _open_own_file(path, or_of_its_folder=True)
    if not is_locked(fd):
        os.close(fd)
        raise FootsenseError(f"{path}: its service has ended")
    return fd


def _open_own_file(path: Path, *, or_of_its_folder: bool = False) -> int:
    """Open a regular file of this user for reading, or one of whom its folder belongs to.

    Raises:
        FootsenseError: It is missing, or something else.
    """
    try:
        fd = open_regular(path, os.O_NOFOLLOW)
    except FileNotFoundError:
        raise FootsenseError(
            f"{path}: no service runs here; start `footsense run`, or name its ring with --ring"
        ) from None
    except OSError as error:
        raise FootsenseError(f"{path}: {error.strerror}") from error
    owners = {os.geteuid(), path.parent.stat().st_uid} if or_of_its_folder else {os.geteuid()}
    if os.fstat(fd).st_uid not in owners:
        os.close(fd)
        raise FootsenseError(f"{path}: belongs to another user")
    return fd


def open_draft(path: Path) -> int:
    """Return a descriptor of a ring that is not ready yet, empty and locked; one that a service has left is used again.

    Raises:
        FootsenseError: Another service makes it, or it is no file of this user.
        OSError: It cannot be made.
    """
    fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    about, reason = os.fstat(fd), ""
    if not stat.S_ISREG(about.st_mode) or about.st_uid != os.geteuid():
        reason = "is not a file of this user"
    else:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            reason = "another service that starts writes this file"
    if reason:
        os.close(fd)
        raise FootsenseError(f"{path}: {reason}")
    os.ftruncate(fd, 0)
    return fd


def check_replaceable(path: Path) -> None:
    """Raise an error unless a new ring may take this name.

    Raises:
        FootsenseError: Another process writes it, or it is something else than a ring that was left over.
    """
    if is_written_ring(path):
        raise FootsenseError(f"{path}: another running service writes this file")


def is_written_ring(path: Path, *, or_of_its_folder: bool = False) -> bool:
    """Return whether a name is that of a ring of a running service; False where there is none, or one left over.

    Args:
        path: The name.
        or_of_its_folder: Whether it may belong to whom its folder belongs to, as to a service of another user.

    Raises:
        FootsenseError: It is the name of something else.
    """
    if not path.is_symlink() and not path.exists():
        return False
    fd = _open_own_file(path, or_of_its_folder=or_of_its_folder)
    try:
        if os.pread(fd, len(_MAGIC_OF_ALL), 0) not in {b"", _MAGIC_OF_ALL}:
            raise FootsenseError(f"{path}: holds something else than footsense's cycles")
        return is_locked(fd)
    finally:
        os.close(fd)


def is_locked(fd: int) -> bool:
    """Return whether the process that writes an open file still runs."""
    with contextlib.suppress(BlockingIOError):
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
        fcntl.flock(fd, fcntl.LOCK_UN)
        return False
    return True
