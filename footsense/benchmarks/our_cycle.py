"""One cycle of the daemon on recorded readings, for benchmarks: estimation, CAN and ring.

A whole cycle: estimate, publish, write into the ring. It sends to a socket pair, which stands for CAN on any machine
and is drained between cycles.
"""

import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from footsense.benchmarks.c_program import CProgram
from footsense.can.wire import SocketWire
from footsense.config import DEFAULT
from footsense.config.sections import Realtime
from footsense.daemon.acquisition import open_scan_source
from footsense.daemon.can_output import can_sink
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.loop import Loop
from footsense.daemon.models import load_models
from footsense.daemon.recording_header import recording_header
from footsense.frames import ELEMENTS, CapFrame, Cycle, Flag, Vector
from footsense.ring.cycle_ring import CycleRing
from footsense.ring.records import ServiceStatus
from footsense.sim.clock import VirtualClock
from footsense.sim.scene_files import load_scene
from footsense.telemetry.journal import LegStateLogger
from footsense.telemetry.systemd import SystemdNotifier

#: Priority of SCHED_FIFO, the default of the service; without it the figures include other processes.
REALTIME_PRIORITY = Realtime().priority
#: Cycles at the begin, in which the feet are tared.
N_WARM_UP_CYCLES = 120
#: The service, with a force on CAN for every cycle: each cycle does all the work.
BENCHMARK_CONFIG = replace(DEFAULT, publish_every=1)


class Loopback:
    """Socket pair and pipe that receive the CAN frames and records of the measured cycles."""

    def __init__(self) -> None:
        self.socket, self._sink = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._drain, self.pipe = os.pipe()
        os.set_blocking(self._drain, False)

    @property
    def file_descriptors(self) -> tuple[int, int, int, int]:
        """File descriptors: both ends of the socket pair, then the pipe's write and read ends."""
        return self.socket.fileno(), self._sink.fileno(), self.pipe, self._drain

    def drain(self) -> None:
        """Read and discard the CAN frames and records of a cycle."""
        with suppress(BlockingIOError):
            while True:
                self._sink.recv(64, socket.MSG_DONTWAIT)
        with suppress(BlockingIOError):
            os.read(self._drain, 1 << 16)

    def close(self) -> None:
        """Close the socket pair and the pipe."""
        self.socket.close()
        self._sink.close()
        os.close(self._drain)
        os.close(self.pipe)


class ServiceCycle(NamedTuple):
    """One cycle of the daemon's pipeline and outputs, ready to run.

    Attributes:
        run: Processes a scan at a time [ns].
        baseline_pf: Returns the baselines at the start of the next cycle [pF], shape (legs, 9).
        ring: Its ring.
        loopback: Receiver of its frames and records.
    """

    run: Callable[[CapFrame, int], Cycle]
    baseline_pf: Callable[[], Vector]
    ring: Path
    loopback: Loopback


@contextmanager
def open_service_cycle() -> Iterator[ServiceCycle]:
    """Set up one cycle of the daemon (pipeline, CAN sink, observers) with sockets in place of CAN.

    Yields:
        The cycle; its ring exists until the end.
    """
    clock, loopback = VirtualClock(), Loopback()
    models = load_models(DEFAULT)
    pipeline = pipeline_for(models, Flag.SIMULATED)
    wire = SocketWire(loopback.socket)
    with (
        TemporaryDirectory(dir="/dev/shm") as folder,
        can_sink(BENCHMARK_CONFIG, clock, None, connect=lambda: wire) as sink,
    ):
        ring = Path(folder) / "ring"
        header = recording_header(models, None, Flag.SIMULATED, clock.now_ns())

        def status() -> ServiceStatus:
            return ServiceStatus(can=sink.stats, baseline=pipeline.baseline_pf.tobytes())

        observers = (
            LegStateLogger(DEFAULT.legs),
            SystemdNotifier(DEFAULT.legs, {}),
            CycleRing(ring, DEFAULT.legs, header, DEFAULT.frames_hz, status),
        )
        loop = Loop(pipeline, sink, observers, clock)

        def run(scan: CapFrame, now_ns: int) -> Cycle:
            clock.sleep_until_ns(now_ns)
            return loop.run_cycle(scan, tuple(sink.commands()))

        try:
            yield ServiceCycle(run, lambda: pipeline.baseline_pf, ring, loopback)
        finally:
            for observer in observers:
                observer.close()
    loopback.close()


def simulated_walk_frames(n: int) -> list[CapFrame]:
    """Return the simulated capacitance frames of `n` conversions of six walking legs."""
    with open_scan_source(DEFAULT, replace(load_scene("measured_walk"), host_cost_us=40.0)) as scan_source:
        return [scan_source.source.read() for _ in range(n)]


def send_time_ns(scan: CapFrame) -> int:
    """Return the sending time assumed for a frame's forces [ns]: 2 ms after its newest reading."""
    return int(scan.t_ns.max()) + 2_000_000


def tared_c_program(folder: Path, scans: list[CapFrame]) -> CProgram:
    """Return the C program, tared with the first frames as the daemon is.

    Raises:
        FootsenseError: It cannot be compiled.
    """
    floor = CProgram(folder, DEFAULT, load_models(DEFAULT).network.card.trained_inputs)
    tared = scans[: DEFAULT.tare.window_scans * ELEMENTS : ELEMENTS]
    floor.tare(np.mean([scan.capacitance_pf for scan in tared], axis=0))
    return floor
