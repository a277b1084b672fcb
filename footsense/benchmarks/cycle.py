"""The part of `footsense benchmark` about one cycle: what it costs us, a floor in C, and a naive program, in turns.

A whole cycle: estimate, publish, count, record. Each of the three sends to a socket of the same kind, a stand-in for
CAN's that any machine has, and records into a pipe of the same kind; both are drained between cycles.
"""

import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from footsense.benchmarks.c_floor import CFloor, codes_of, has_c_floor
from footsense.benchmarks.naive import NaiveCycle, naive_cycle
from footsense.can.socketcan import SocketWire
from footsense.clock import fifo_priority, gc_disabled, stopwatch_ns
from footsense.config import DEFAULT, Realtime
from footsense.daemon.acquisition import open_scan_source
from footsense.daemon.estimation import load_network, pipeline_for
from footsense.daemon.loop import step
from footsense.daemon.service import can_sink
from footsense.errors import FootsenseError
from footsense.frames import CanStatistics, CapFrame, Cycle, Flag, State
from footsense.recording.cycle_pipe import CyclePipe
from footsense.sim.clock import VirtualClock
from footsense.sim.scene import load_scene
from footsense.telemetry.journal import Journal
from footsense.telemetry.metrics import MetricsObserver
from footsense.telemetry.systemd import SystemdNotifier, SystemdObserver

__all__ = [
    "PRIORITY",
    "WARM_UP",
    "OurCycle",
    "Outlets",
    "cycle_figures",
    "our_cycle",
    "recorded_scans",
    "sent_ns",
    "tared_floor",
]

#: Of SCHED_FIFO, as the service has it by default; without it the figures tell of whoever else is busy.
PRIORITY = Realtime().priority
#: Scans in which the feet are tared.
WARM_UP = 40
#: Cycles in a row of one way before the next way has its turn.
_RUN = 25
#: Largest difference between the floor's forces and ours [N]: half a step of the wire.
_SAME_N = 1e-3


class Outlets:
    """Where the frames and the record of a cycle go."""

    def __init__(self) -> None:
        self.socket, self._sink = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._drain, self.pipe = os.pipe()
        os.set_blocking(self._drain, False)

    @property
    def fds(self) -> tuple[int, int, int, int]:
        """Both ends of the socket, and the pipe's to write and to read."""
        return self.socket.fileno(), self._sink.fileno(), self.pipe, self._drain

    def drain(self) -> None:
        """Take out what a cycle has left."""
        with suppress(BlockingIOError):
            while True:
                self._sink.recv(64, socket.MSG_DONTWAIT)
        with suppress(BlockingIOError):
            os.read(self._drain, 1 << 16)

    def close(self) -> None:
        """Release all ends."""
        self.socket.close()
        self._sink.close()
        os.close(self._drain)
        os.close(self.pipe)


class _Recording:
    """An observer that copies every cycle into a pipe, as the recorder does."""

    def __init__(self, pipe: int, legs: tuple[str, ...]) -> None:
        self._pipe = CyclePipe(pipe, legs, {}, blocking=False)

    def observe(self, cycle: Cycle) -> None:
        """Copy one cycle."""
        self._pipe.send(cycle)

    def close(self) -> None:
        """Nothing waits."""


class OurCycle(NamedTuple):
    """A cycle of the service's own parts.

    Attributes:
        run: Does one cycle with a scan, as of a time [ns].
        baseline_pf: Returns the zeros that the next cycle begins with [pF], shape (legs, 9).
        counters: File of its metrics.
        outlets: Where its frames and records go.
    """

    run: Callable[[CapFrame, int], Cycle]
    baseline_pf: Callable[[], NDArray[np.float64]]
    counters: Path
    outlets: Outlets


@contextmanager
def our_cycle() -> Iterator[OurCycle]:
    """Put together what the service does with a scan.

    Yields:
        The cycle; its counters are there until the end.
    """
    clock, stats, outlets = VirtualClock(), CanStatistics(), Outlets()
    pipeline = pipeline_for(DEFAULT, load_network(DEFAULT), Flag.SIMULATED)
    wire = SocketWire(outlets.socket, lambda: None)
    with (
        TemporaryDirectory(dir="/dev/shm") as folder,
        can_sink(DEFAULT, clock, None, stats, connect=lambda: wire) as sink,
    ):
        counters = Path(folder) / "counters"
        metrics = MetricsObserver(DEFAULT.legs, stats, counters)
        observers = (
            Journal(DEFAULT.legs),
            SystemdObserver(SystemdNotifier({}), DEFAULT.legs),
            metrics,
            _Recording(outlets.pipe, DEFAULT.legs),
        )

        def run(scan: CapFrame, now_ns: int) -> Cycle:
            clock.sleep_until_ns(now_ns)
            return step(scan, tuple(sink.commands()), pipeline, sink, observers, clock)

        try:
            yield OurCycle(run, lambda: pipeline.baseline_pf, counters, outlets)
        finally:
            metrics.close()
    outlets.close()


def recorded_scans(n: int) -> list[CapFrame]:
    """Return scans of six walking legs in turn."""
    with open_scan_source(DEFAULT, replace(load_scene("measured_walk"), host_cost_us=40.0)) as scan_source:
        return [scan_source.source.read() for _ in range(n)]


def sent_ns(scan: CapFrame) -> int:
    """Return when a scan is processed, in its own time [ns]: when the last element has been read."""
    return int(scan.t_ns.max()) + 2_000_000


def tared_floor(folder: Path, scans: list[CapFrame]) -> CFloor:
    """Return the floor with the zeros that the service's tare finds in the first scans.

    Raises:
        FootsenseError: It cannot be compiled.
    """
    floor = CFloor(folder, DEFAULT, load_network(DEFAULT).card.trained_inputs)
    floor.tare(np.mean([scan.capacitance_pf for scan in scans[: DEFAULT.tare.window_scans]], axis=0))
    return floor


class _Times(NamedTuple):
    ours_ns: list[int]
    floor_ns: list[int]
    naive_ns: list[int]


def cycle_figures(scans: list[CapFrame]) -> dict[str, Any]:
    """Return what a cycle costs [us] and the ratios; None where there is nothing to compare with.

    Hot first, as one cycle follows another; then cold, after the naive program has swept the processor's caches as the
    rest of a robot does.

    Args:
        scans: What to process, WARM_UP of them before anything counts.

    Raises:
        FootsenseError: The floor's forces are not ours.
    """
    hot, cold = _figures(scans, _RUN), _figures(scans, 1)
    return {**hot, "cold": cold}


def _figures(scans: list[CapFrame], run: int) -> dict[str, float | None]:
    with TemporaryDirectory() as folder, our_cycle() as ours, naive_cycle(DEFAULT) as naive:
        floor = tared_floor(Path(folder), scans) if has_c_floor() else None
        with gc_disabled(), fifo_priority(PRIORITY):
            times = _time(scans, run, ours, floor, naive)
    ours_us, floor_us, naive_us = (np.array(part[WARM_UP:]) * 1e-3 for part in times)
    p50 = float(np.median(ours_us))
    return {
        "p50": p50,
        "p99": float(np.quantile(ours_us, 0.99)),
        "c_floor_p50": float(np.median(floor_us)) if floor else None,
        "naive_p50": float(np.median(naive_us)) if naive else None,
        "cycle_over_c_floor": p50 / float(np.median(floor_us)) if floor else None,
        "naive_over_cycle": float(np.median(naive_us)) / p50 if naive else None,
    }


def _time(
    scans: list[CapFrame], run: int, ours: OurCycle, floor: CFloor | None, naive: NaiveCycle | None
) -> _Times:
    """Time each cycle three ways, `run` cycles in a row, so that what else the machine does strikes all alike."""
    times = _Times([], [], [])
    outlets = ours.outlets
    for first in range(0, len(scans), run):
        done = []
        for scan in scans[first : first + run]:
            now_ns, baseline_pf = sent_ns(scan), ours.baseline_pf()
            start_ns = stopwatch_ns()
            cycle = ours.run(scan, now_ns)
            times.ours_ns.append(stopwatch_ns() - start_ns)
            outlets.drain()
            # Nothing else of the cycle is kept: the service keeps none, and new memory is cold.
            valid = cycle.forces.state == State.VALID
            done.append((scan, now_ns, baseline_pf, cycle.forces.force_n[valid], valid))
            del cycle
        for number, (scan, now_ns, baseline_pf, ours_n, valid) in enumerate(done, first):
            if floor is None:
                break
            codes = codes_of(scan)
            floor.tare(baseline_pf)
            start_ns = stopwatch_ns()
            force_n = floor.run(scan, codes, now_ns, outlets.socket.fileno(), outlets.pipe)
            times.floor_ns.append(stopwatch_ns() - start_ns)
            outlets.drain()
            if number >= WARM_UP:
                _check_same(scan, ours_n, force_n, valid)
        for scan, now_ns, *_ in done:
            if naive is None:
                break
            start_ns = stopwatch_ns()
            naive.run(scan, now_ns, outlets.socket, outlets.pipe)
            times.naive_ns.append(stopwatch_ns() - start_ns)
            outlets.drain()
    return times


def _check_same(
    scan: CapFrame,
    ours_n: NDArray[np.float64],
    floor_n: NDArray[np.float64] | None,
    valid: NDArray[np.bool_],
) -> None:
    """Check that the floor did the same work.

    Args:
        scan: What both were given.
        ours_n: Our forces of the legs that are valid [N], shape (valid legs, 3).
        floor_n: The floor's of all [N], shape (legs, 3); None if it gave none.
        valid: Which legs are, shape (legs,).

    Raises:
        FootsenseError: It gives another force than we do, or none.
    """
    if floor_n is None:
        raise FootsenseError(
            f"scan {scan.sequence}: the floor in C gives no force where every leg is healthy"
        )
    difference_n = np.abs(ours_n - floor_n[valid]).max(initial=0.0)
    if not difference_n < _SAME_N:
        raise FootsenseError(
            f"scan {scan.sequence}: the floor in C differs by {difference_n:.2g} N from ours"
        )
