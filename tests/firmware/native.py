"""The reference firmware as a library in this process."""

import ctypes
import os
import shutil
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from tests.contract.c_decoder import SOURCES, compile_c
from tests.firmware.board import Board

__all__ = ["CORE", "NativeTracker", "native_scan"]

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


class _Span(ctypes.Structure):
    _fields_ = (("from_ns", ctypes.c_int64), ("to_ns", ctypes.c_int64))


class _Run(ctypes.Structure):
    _fields_ = (
        ("t_ns", ctypes.c_int64),
        ("step_ns", ctypes.c_int32),
        ("first", ctypes.c_uint8),
        ("missing", ctypes.c_uint16),
        ("code", ctypes.c_uint16 * 9),
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


class NativeTracker:
    """The firmware's tracker of a converter, `footsense_stages.h`; all times in whole nanoseconds.

    Attributes:
        is_doubtful: Whether a status did not fit.
    """

    def __init__(self) -> None:
        self._library = _library()
        self._state = ctypes.create_string_buffer(
            ctypes.c_uint.in_dll(self._library, "native_stages_bytes").value
        )
        self._library.footsense_stages_newest.restype = _Run
        self.is_doubtful = False

    def start(self, at: tuple[float, float]) -> None:
        """Start the count: the sequence began in a span [ns]."""
        self._library.footsense_stages_start(self._state, _Span(*map(round, at)))

    def trust(self) -> None:
        """Count anew: the chip holds its settings."""
        self._library.footsense_stages_trust(self._state)
        self.is_doubtful = False

    def miss(self, until_ns: float) -> None:
        """Expect that a status was read until now, and lost."""
        self._library.footsense_stages_miss(self._state, ctypes.c_int64(round(until_ns)))

    def stamped(
        self,
        before: int,
        before_at: tuple[float, float],
        held: Sequence[int],
        behind: int,
        behind_at: tuple[float, float],
    ) -> list[tuple[int, float]]:
        """Return the conversions whose codes are stored, and the middle of each [ns]; none if a burst gave no new one.

        The codes are the conversions' own numbers, of which 16 bits are stored.
        """
        before_span, behind_span = (_Span(*map(round, at)) for at in (before_at, behind_at))
        codes = (ctypes.c_uint16 * 9)(*(number % 2**16 for number in held))
        taken = self._library.footsense_stages_take(
            self._state, before, before_span, codes, behind, behind_span
        )
        self.is_doubtful = taken == 2
        run = self._library.footsense_stages_newest(self._state)
        newest = max(held)
        stored = [
            (newest - (newest - run.code[k]) % 2**16, run.t_ns + k * run.step_ns)
            for k in range(9)
            if not run.missing >> k & 1
        ]
        return stored if taken == 0 and any(number in held for number, _ in stored) else []


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
