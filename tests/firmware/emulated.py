"""The reference firmware on an emulated Cortex-M: QEMU runs it, and asks here for buses, time and line."""

import os
import shutil
import struct
import subprocess
import weakref
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import IO, NamedTuple

from tests.contract.c_decoder import WARNINGS
from tests.firmware.board import Board
from tests.firmware.native import CORE, FIRMWARE

__all__ = ["MISSING", "WANTED", "Emulated", "build", "sizes"]

_TOOLS = ("arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")
#: Tools that are not installed, in words; empty for none.
MISSING = ", ".join(tool for tool in _TOOLS if shutil.which(tool) is None)
#: Set by `make firmware`, which alone runs the emulator.
WANTED = bool(os.environ.get("FOOTSENSE_EMULATED")) and not MISSING
#: For the processor of the RP2040, whose instructions every other Cortex-M has, too.
_FLAGS = [
    "-mcpu=cortex-m0plus",
    "-mthumb",
    "-Os",
    "-ffunction-sections",
    "-fdata-sections",
    "-Wl,--gc-sections",
]
#: Instructions in a tick of the emulated processor's counter, of 12.5 MHz, at a nanosecond an instruction.
_INSTRUCTIONS_PER_TICK = 80


def build(port: str, folder: Path) -> Path:
    """Return the firmware with a port, linked, without a single warning.

    Args:
        port: Folder of the port.
        folder: Where to build it.
    """
    program = folder / f"{port}.elf"
    sources = [*CORE, *sorted((FIRMWARE / port).glob("*.[cS]"))]
    link = [
        "-nostartfiles",
        "--specs=nano.specs",
        "-T",
        str(FIRMWARE / port / "memory.ld"),
        "-o",
        str(program),
    ]
    command = ["arm-none-eabi-gcc", *WARNINGS, *_FLAGS, f"-I{FIRMWARE}", *map(str, sources), *link]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return program


def sizes(program: Path) -> tuple[int, int]:
    """Return flash and RAM of a program, without its stack [bytes]."""
    command = ["arm-none-eabi-size", str(program)]
    text, data, bss = map(int, subprocess.check_output(command, text=True).splitlines()[1].split()[:3])
    return text + data, data + bss


@cache
def _program() -> Path:
    return build("emulated", Path(mkdtemp(prefix="footsense-mcu-")))


class Spent(NamedTuple):
    """What the firmware has used for a scan.

    Attributes:
        instructions: Instructions, without those of the port.
        stack_bytes: Deepest stack so far.
    """

    instructions: int
    stack_bytes: int


def _end(emulator: subprocess.Popen[bytes], folder: Path, *pipes: IO[bytes]) -> None:
    emulator.kill()
    emulator.wait()
    for pipe in pipes:
        pipe.close()
    shutil.rmtree(folder)


class Emulated:
    """An emulator with the firmware.

    Args:
        board: The board that it runs on.

    Attributes:
        spent: Of each scan.
    """

    def __init__(self, board: Board) -> None:
        self._folder = Path(mkdtemp(prefix="footsense-mcu-"))
        for name in ("to_mcu", "from_mcu"):
            os.mkfifo(self._folder / name)
        command = [
            "qemu-system-arm",
            "-M",
            "lm3s6965evb",
            "-display",
            "none",
            "-monitor",
            "none",
            "-serial",
            "none",
        ]
        command += [
            "-semihosting-config",
            "enable=on,target=native",
            "-icount",
            "shift=0",
            "-kernel",
            str(_program()),
        ]
        self._emulator = subprocess.Popen(command, cwd=self._folder, stderr=subprocess.DEVNULL)
        self._to_mcu = (self._folder / "to_mcu").open("wb", buffering=0)
        self._from_mcu = (self._folder / "from_mcu").open("rb")
        self._board = board
        self.spent: list[Spent] = []
        weakref.finalize(self, _end, self._emulator, self._folder, self._to_mcu, self._from_mcu)
        assert self._read(5) == b"W" + bytes(4)  # for the time at which it starts
        self._to_mcu.write(struct.pack("<Ii", board.now_us(), -1))

    def __call__(self) -> None:
        """Do a scan, from its wait to the end of what follows."""
        while (asked := self._read(1)) != b"W":
            if asked == b"T":
                self._transfer()
            else:
                self._send()
        self._board.wait_until_us(*struct.unpack("<I", self._read(4)))
        self._to_mcu.write(struct.pack("<Ii", self._board.now_us(), self._board.receive()))

    def _read(self, n: int) -> bytes:
        data = self._from_mcu.read(n)
        assert len(data) == n, "the emulator has ended"
        return data

    def _transfer(self) -> None:
        legs, n_out, n_in = self._read(3)
        answered, stuck, read = self._board.transfer(legs, self._read(n_out), n_in)
        answers = (data for leg, data in enumerate(read) if answered >> leg & 1)
        self._to_mcu.write(struct.pack("<IBB", self._board.now_us(), answered, stuck) + b"".join(answers))

    def _send(self) -> None:
        ticks, stack_bytes, n = struct.unpack("<III", self._read(12))
        self.spent.append(Spent(ticks * _INSTRUCTIONS_PER_TICK, stack_bytes))
        self._board.send(self._read(n))
