"""The reference firmware as a library in this process."""

import ctypes
import os
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from tests.contract.c_decoder import SOURCES, compile_c
from tests.firmware.board import Board

__all__ = ["CORE", "native_scan"]

FIRMWARE = SOURCES.parent / "mcu"
CORE = [FIRMWARE / "footsense_scan.c", FIRMWARE / "footsense_stages.c", SOURCES / "footsense_serial.c"]

_U8 = ctypes.POINTER(ctypes.c_uint8)
_TRANSFER = ctypes.CFUNCTYPE(ctypes.c_uint16, ctypes.c_uint8, _U8, ctypes.c_uint8, _U8, ctypes.c_uint8)
_NOW = ctypes.CFUNCTYPE(ctypes.c_uint32)
_WAIT = ctypes.CFUNCTYPE(None, ctypes.c_uint32)
_SEND = ctypes.CFUNCTYPE(None, _U8, ctypes.c_uint16)
_RECEIVE = ctypes.CFUNCTYPE(ctypes.c_int)
_READ_MAX = 26


class _Port(ctypes.Structure):
    _fields_ = (
        ("transfer", _TRANSFER),
        ("now_us", _NOW),
        ("wait_until_us", _WAIT),
        ("send", _SEND),
        ("receive", _RECEIVE),
    )


@cache
def _library() -> ctypes.CDLL:
    """Return the firmware, built once in a process; FOOTSENSE_SANITIZE=1 with checks of memory and arithmetic."""
    folder = Path(mkdtemp(prefix="footsense-mcu-"))
    checks = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g"]
    try:
        compile_c(
            folder,
            *(checks if os.environ.get("FOOTSENSE_SANITIZE") else ()),
            "-shared",
            "-fPIC",
            f"-I{FIRMWARE}",
            *CORE,
            Path(__file__).with_name("native_port.c"),
            "-o",
            folder / "mcu.so",
        )
        return ctypes.CDLL(str(folder / "mcu.so"))
    finally:
        shutil.rmtree(folder)


def native_scan(board: Board) -> Callable[[], None]:
    """Start the firmware on a board; return what does its next scan."""
    library = _library()

    def transfer(
        legs: int,
        out: "ctypes._Pointer[ctypes.c_uint8]",
        n_out: int,
        into: "ctypes._Pointer[ctypes.c_uint8]",
        n_in: int,
    ) -> int:
        answered, stuck, read = board.transfer(legs, bytes(out[:n_out]), n_in)
        for leg, data in enumerate(read):
            if n_in and answered >> leg & 1:
                ctypes.memmove(ctypes.byref(into.contents, _READ_MAX * leg), data, n_in)
        return answered | stuck << 8

    port = _Port(
        _TRANSFER(transfer),
        _NOW(board.now_us),
        _WAIT(board.wait_until_us),
        _SEND(lambda data, n: board.send(bytes(data[:n]))),
        _RECEIVE(board.receive),
    )
    state = ctypes.create_string_buffer(ctypes.c_uint.in_dll(library, "native_scan_bytes").value)

    def scan() -> None:
        library.native_bind(ctypes.byref(port))
        library.footsense_scan_next(state)

    library.native_bind(ctypes.byref(port))
    library.footsense_scan_start(state)
    return scan
