"""What board `mcu` gains beside board `ad7147` on Linux's I2C: error and age of the forces, and load of the computer.

    python -m tests.firmware.gain    prints the table of firmware_interface/mcu/README.md

Feet, chips, network and walk are the same. Instructions are those of what reads the feet on the computer, counted by
valgrind, as the difference of two runs.
"""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from firmware_interface.can.codes import USABLE
from footsense.acquisition.mcu_source import McuSource, Serial
from footsense.config import DEFAULT, Config
from footsense.config.sections import Bus
from footsense.daemon.acquisition import open_scan_source
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.models import load_models
from footsense.daemon.simulation import simulated_robot
from footsense.frames import LEGS, CapFrame, Vector
from footsense.ports import Clock, FrameSource
from footsense.sim.clock import VirtualClock
from footsense.sim.scene import Effects, Scene
from footsense.sim.scene_loads import MeasuredWalk
from tests.firmware.board import BAUD, Board, Line
from tests.firmware.native import native_scan

S_NS = 1_000_000_000
SCENE = Scene(
    description="",
    load=MeasuredWalk(peak_force_n=1.0),
    lead_in_s=1.0,
    gait_table=True,
    effects=Effects(converter_noise=True, converter_clock_rel=0.04),
    host_cost_us=100.0,
)
ON_MCU = Config(board="mcu", serial=Serial(device="sim", baud=BAUD), can=DEFAULT.can)
#: Each leg on a bus of its own, for the firmware.
FEET = replace(
    DEFAULT,
    buses=tuple(
        msgspec.convert({"device": f"sim{n}", "addresses": {leg: 0x2C}}, Bus) for n, leg in enumerate(LEGS)
    ),
)
#: From the last status to the first byte on the line, on the emulated RP2040 [ns].
CPU_NS = 660_000
BEGIN_S, END_S = 1.5, 5.0
N_COUNTED = 200, 400


class Walked(NamedTuple):
    """Forces of a walk.

    Attributes:
        frames_hz: Forces of a leg a second [Hz].
        age_ms: Age of the readings behind a force that is ready, as the service tells it, mean [ms].
        rms_mn: Difference of a force that is ready from the true one of then, rms of each axis [mN], shape (3,).
        p95_mn: The same, the 95th percentile of its size [mN].
        usable_rel: Share of forces that may be used [1].
    """

    frames_hz: float
    age_ms: float
    rms_mn: Vector
    p95_mn: float
    usable_rel: float


def walked(
    config: Config, source: FrameSource, clock: Clock, true_force_n_at: Callable[[int], Vector]
) -> Walked:
    """Return what a pipeline makes of a walk."""
    pipeline = pipeline_for(load_models(config), 0)
    errors_n, ages_ns, usable, times_ns = [], [], [], []
    while clock.now_ns() < END_S * S_NS:
        frame = source.read()
        assert isinstance(frame, CapFrame)
        now_ns = clock.now_ns()
        forces = pipeline.process(frame, now_ns)[0]
        if now_ns > BEGIN_S * S_NS:
            good = np.isin(forces.state, sorted(USABLE))
            errors_n.append((forces.force_n - true_force_n_at(now_ns))[good])
            ages_ns.append(forces.age_ns[good])
            usable.append(good)
            times_ns.append(now_ns)
    errors_mn = 1e3 * np.concatenate(errors_n)
    return Walked(
        (len(times_ns) - 1) * S_NS / (times_ns[-1] - times_ns[0]),
        1e-6 * float(np.mean(np.concatenate(ages_ns))),
        np.sqrt(np.mean(np.square(errors_mn), axis=0)),
        float(np.percentile(np.linalg.norm(errors_mn, axis=1), 95)),
        float(np.mean(usable)),
    )


def on_linux() -> Walked:
    """Return the walk of board `ad7147` as deployed, three legs on each of two buses."""
    with open_scan_source(DEFAULT, SCENE) as started:
        assert started.true_force_n_at
        return walked(DEFAULT, started.source, started.clock, started.true_force_n_at)


class Recorded(Line):
    """A line whose bytes are kept with their times."""

    def __init__(self, board: Board, clock: Clock) -> None:
        super().__init__(board, native_scan, clock)
        self.read_at: list[tuple[int, bytes]] = []

    def read(self) -> bytes:
        """Return what has arrived."""
        data = super().read()
        self.read_at.append((self._clock.now_ns(), data))
        return data


def on_mcu() -> tuple[Walked, list[tuple[int, bytes]]]:
    """Return the walk of board `mcu` with the reference firmware, and what came over its line."""
    robot = simulated_robot(FEET, replace(SCENE, host_cost_us=0.0))
    board, clock = Board(robot.buses, [bus.clock for bus in robot.buses]), VirtualClock()
    board.cpu_ns = CPU_NS
    line = Recorded(board, clock)
    line.start()
    source = McuSource(line, clock, Serial(device="sim", baud=BAUD))
    return walked(ON_MCU, source, clock, robot.true_force_n_at), line.read_at


class Replay:
    """A line that hands over again what came."""

    n_opened = 1

    def __init__(self, read_at: list[tuple[int, bytes]], clock: VirtualClock) -> None:
        self._read_at, self._clock = iter(read_at), clock

    def read(self) -> bytes:
        """Return what came next, at the time at which it did."""
        t_ns, data = next(self._read_at)
        self._clock.sleep_until_ns(t_ns)
        return data

    def wait_for_bytes_until_ns(self, t_ns: int) -> None:
        """Do nothing: `read` waits."""

    def write(self, data: bytes) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def replay(file: Path, n_frames: int) -> None:
    """Read frames of what came over a line."""
    clock = VirtualClock()
    source = McuSource(
        Replay([(t_ns, bytes.fromhex(data)) for t_ns, data in json.loads(file.read_text())], clock),
        clock,
        Serial(device="sim", baud=BAUD),
    )
    for _ in range(n_frames):
        source.read()


def instructions_a_frame(read_at: list[tuple[int, bytes]]) -> float:
    """Return the instructions of user space that a frame of board `mcu` takes."""
    counts = []
    with TemporaryDirectory() as folder:
        (Path(folder) / "line").write_text(json.dumps([(t_ns, data.hex()) for t_ns, data in read_at]))
        for n in N_COUNTED:
            command = [
                "valgrind",
                "--tool=none",
                sys.executable,
                "-m",
                "tests.firmware.gain",
                folder + "/line",
                str(n),
            ]
            command[1:2] = ["--tool=callgrind", f"--callgrind-out-file={folder}/counts"]
            done = subprocess.run(
                command, capture_output=True, text=True, check=True, env=os.environ | {"PYTHONHASHSEED": "0"}
            )
            counts.append(int(re.findall(r"Collected : (\d+)", done.stderr)[0]))
    return (counts[1] - counts[0]) / (N_COUNTED[1] - N_COUNTED[0])


def main() -> None:
    """Print the table; with a recorded line and a number, read so many frames of it."""
    if sys.argv[1:]:
        replay(Path(sys.argv[1]), int(sys.argv[2]))
        return
    linux, (mcu, read_at) = on_linux(), on_mcu()
    for name, of in (("ad7147", linux), ("mcu", mcu)):
        axes = ", ".join(f"{axis:.1f}" for axis in of.rms_mn)
        print(f"{name:8} {of.frames_hz:.1f} frames a second, {of.usable_rel:.2%} of the forces usable")
        print(f"    age {of.age_ms:.2f} ms, rms error {axes} mN, 95th percentile {of.p95_mn:.1f} mN")
    committed = json.loads(Path("tests/golden/instructions.json").read_text())
    of_linux, of_mcu = committed["figures"]["healthy"]["acquisition"], instructions_a_frame(read_at)
    print(
        f"acquisition of a frame: ad7147 {of_linux * 1e-6:.2f}, mcu {of_mcu * 1e-6:.2f} million instructions"
    )


if __name__ == "__main__":
    main()
