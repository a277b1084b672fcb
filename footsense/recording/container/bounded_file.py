"""File wrapper for reading MCAP files that may be damaged."""

import os
import struct
from typing import BinaryIO

import msgspec
from mcap.exceptions import McapError
from zstandard import ZstdError

#: Largest chunk that is unpacked [bytes]; footsense's have 64 KiB.
MAX_CHUNK_BYTES = 1 << 24

#: Errors of the libraries below on damaged bytes.
DAMAGE_ERRORS = (
    *(McapError, ZstdError, msgspec.MsgspecError, ValueError, LookupError, TypeError, AttributeError),
    *(OverflowError, MemoryError, RecursionError, EOFError, struct.error),
)


class BoundedFile:
    """File wrapper that limits each read to the end of the file, even for a damaged length."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.size = os.fstat(file.fileno()).st_size

    def read(self, n: int) -> bytes:
        """Return `n` bytes; fewer at the end of the file.

        Raises:
            ValueError: No written record is so large.
        """
        if n > MAX_CHUNK_BYTES:
            raise ValueError("a record is larger than any that is written")
        return self._file.read(min(n, self.size - self._file.tell()))
