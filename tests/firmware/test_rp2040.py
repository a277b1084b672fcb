"""The port of the firmware for an RP2040, as an image of its flash, on an emulator of that chip, with AD7147s."""

import shutil
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pytest

from firmware_interface.conversion_order import CONVERSION_ORDERS
from firmware_interface.mcu.uf2 import uf2
from firmware_interface.serial_decoder import SerialDecoder
from firmware_interface.serial_frames import NO_VALUE_BASE, NoValue, Record, Sending, began_at
from firmware_interface.wire_timing import BUS_FREE_NS, transaction_bits
from tests.contract.ad7147_robot import N_LEGS, Robot, Wiring, true_pf
from tests.firmware.board import Board
from tests.firmware.emulated import WANTED, build

ROOT = Path(__file__).parents[2]
#: rp2040js, which `make firmware` installs where npm is.
EMULATOR = ROOT / "build/firmware/node_modules"
BIT_NS, RUNS_US, SETTLED_NS = 2500, 400_000, 220_000_000


class Idle:
    """A board without firmware, on which only time passes."""

    def __init__(self, board: Board) -> None:
        self._board = board

    def __call__(self) -> None:
        """Let a scan's time pass."""
        self._board.wait_until_us((self._board.now_us() + 5000) % 2**32)


class Sent(NamedTuple):
    """What the firmware sends, when, and how long after the last word that it read [ns]."""

    t_ns: int
    after_ns: int
    what: Record | Sending


def sent(*arguments: str) -> Iterator[Sent]:
    """Yield what the firmware sends; its legs have simulated chips."""
    read_ns = 0
    chips = Robot(Wiring(N_LEGS, has_mux=False, boot=Idle)).chips
    decoder = SerialDecoder()
    with TemporaryDirectory() as folder:
        image = Path(folder) / "image"
        program = build("rp2040", Path(folder))
        subprocess.run(["arm-none-eabi-objcopy", "-O", "binary", str(program), str(image)], check=True)
        blocks = uf2(image.read_bytes())
        image.write_bytes(b"".join(blocks[at + 32 : at + 288] for at in range(0, len(blocks), 512)))
        command = ["node", str(Path(__file__).with_name("rp2040.cjs")), str(image), str(RUNS_US), *arguments]
        with subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={"NODE_PATH": str(EMULATOR), "PATH": "/usr/bin:/bin"},
        ) as emulator:
            assert emulator.stdin
            assert emulator.stdout
            while head := emulator.stdout.read(11):
                what, leg, at_ns, n = struct.unpack("<cBdB", head)
                data, t_ns, answer = emulator.stdout.read(n), round(at_ns), b""
                if what == b"A":
                    answer = bytes((data[0] == chips[leg].address and chips[leg].acknowledges(t_ns),))
                elif what == b"R":
                    read_ns = t_ns + transaction_bits(0, 1) * BIT_NS
                    answer = chips[leg].read(2, t_ns + transaction_bits(0, 1) * BIT_NS + BUS_FREE_NS)
                elif what == b"W":
                    chips[leg].write(data, t_ns + BUS_FREE_NS)
                elif what == b"U":
                    yield from (Sent(t_ns, t_ns - read_ns, record) for record in decoder.feed(data))
                else:
                    # Where the file's own second stage turns the watchdog's reset on, and pins are turned to the UART.
                    assert not data.replace(b"Unimplemented peripheral write to 0x48: 0x2", b"")
                emulator.stdin.write(answer)
                emulator.stdin.flush()
    assert not decoder.losses


needs_emulator = pytest.mark.skipif(
    not (WANTED and shutil.which("node") and EMULATOR.is_dir()),
    reason="by make firmware, with node and rp2040js",
)


@needs_emulator
def test_the_records_of_six_legs_are_right() -> None:
    """Each value is that of its time; all legs have theirs in 220 ms, and then in every scan."""
    n_settled, errors_ff = 0, [0.0]
    for t_ns, after_ns, record in sent():
        if isinstance(record, Sending):
            assert t_ns < SETTLED_NS or after_ns < 800_000
        else:
            values = np.array(record.values_af())
            if (values >= NO_VALUE_BASE + 16).all():
                n_settled += t_ns > SETTLED_NS
                place = (began_at(record.flags) + np.arange(9)) % 9
                element = np.array(CONVERSION_ORDERS["lo_shu"])[place]
                at_ns = 1000 * (record.t_us + record.step_us * np.arange(9))
                right_pf = true_pf(np.array(record.leg - 1), element, at_ns)
                errors_ff += (1e3 * np.abs(1e-6 * values[element] - right_pf)).tolist()
    assert max(errors_ff) < 3.0
    assert n_settled >= N_LEGS * 175 // 5


@needs_emulator
def test_a_line_that_is_held_low_is_clocked_free_or_said() -> None:
    """One chip was interrupted in a byte; the line of another has a short, and no other leg is touched."""
    last = {
        record.leg: record.values_af()[0]
        for _, _, record in sent("1:5", "4:1e9")
        if isinstance(record, Record)
    }
    assert last.pop(5) == NO_VALUE_BASE + NoValue.BUS_STUCK
    assert min(last.values()) > 0
