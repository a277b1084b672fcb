"""Files that somebody named, opened without waiting: a FIFO or a device in their place is an error.

Every reader of such a file opens it here, and reads a bounded part of it. What a program keeps for itself is written
whole or not at all.
"""

import errno
import os
import stat
from pathlib import Path

#: Largest file of a model that is read [bytes]; the largest released one has 0.6 million.
MAX_FILE_BYTES = 1 << 26


def open_regular(path: Path, flags: int = 0) -> int:
    """Return a descriptor of a regular file, for reading.

    Args:
        path: The file.
        flags: More flags of open(2).

    Raises:
        OSError: It is missing or may not be read, or something else has its name.
    """
    not_regular = OSError(errno.EINVAL, "is not a regular file", str(path))
    try:
        fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC | flags)
    except OSError as error:
        # A socket, or a link that is not to be followed.
        is_special = error.errno in {errno.ENXIO, errno.ELOOP}
        raise (not_regular if is_special else error) from None
    except ValueError as error:  # a null character in its name
        raise OSError(errno.EINVAL, str(error), str(path)) from None
    kind = os.fstat(fd).st_mode
    if not stat.S_ISREG(kind):
        os.close(fd)
        is_folder = stat.S_ISDIR(kind)
        raise OSError(errno.EISDIR, "Is a directory", str(path)) if is_folder else not_regular
    return fd


def read_regular(path: Path, max_bytes: int = MAX_FILE_BYTES) -> bytes:
    """Return the content of a regular file.

    Raises:
        OSError: As of `open_regular`, or it has more bytes than are read.
    """
    with os.fdopen(open_regular(path), "rb") as file:
        content = file.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise OSError(errno.EFBIG, f"has more than the {max_bytes} bytes that are read", str(path))
    return content


def write_whole(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, also in a power cut; its folder is created if missing.

    Raises:
        OSError: It cannot be written.
    """
    draft = path.with_suffix(".draft")
    path.parent.mkdir(parents=True, exist_ok=True)
    with draft.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)
