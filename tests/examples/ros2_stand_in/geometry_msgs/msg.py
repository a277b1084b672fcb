"""The one message that the examples take."""

import struct
from types import SimpleNamespace
from typing import Any


class WrenchStamped:
    """Its bytes, read by hand."""

    @staticmethod
    def of_cdr(data: bytes) -> Any:
        sec, nanosec, length = struct.unpack_from("<iII", data, 4)
        end = 16 + length
        body = 4 + (end - 4 + 7) // 8 * 8
        x, y, z, *_ = struct.unpack_from("<6d", data, body)
        stamp = SimpleNamespace(sec=sec, nanosec=nanosec)
        header = SimpleNamespace(stamp=stamp, frame_id=data[16 : end - 1].decode())
        return SimpleNamespace(header=header, wrench=SimpleNamespace(force=SimpleNamespace(x=x, y=y, z=z)))
