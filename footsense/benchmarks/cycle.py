"""Part of `footsense benchmark`: durations of a daemon cycle, the C floor and a naive program, in turns.

A whole cycle: estimate, publish, count, record. Each of the three sends to a socket pair, which stands for CAN on any
machine, and records into a pipe; both are drained between cycles.
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
from footsense.config import DEFAULT
from footsense.config.sections import Realtime
from footsense.daemon.acquisition import open_scan_source
from footsense.daemon.can_output import can_sink
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.loop import Loop
from footsense.daemon.models import load_models
from footsense.errors import FootsenseError
from footsense.frames import CapFrame, Cycle, Flag, State
from footsense.ports import Observer
from footsense.recording.cycle_pipe import CyclePipe
from footsense.sim.clock import VirtualClock
from footsense.sim.scene import load_scene
from footsense.telemetry.journal import Journal
from footsense.telemetry.metrics import MetricsObserver
from footsense.telemetry.systemd import SystemdObserver

#: Priority of SCHED_FIFO, the default of the service; without it the figures include other processes.
PRIORITY = Realtime().priority
#: Scans at the begin, in which the feet are tared.
WARM_UP = 40
#: Cycles in a row of one program before the turn of the next.
_RUN = 25
#: Largest difference between the floor's forces and ours [N]: half a step of the wire.
_SAME_N = 1e-3


class Loopback:
    """A socket pair and a pipe that take the frames and the record of a cycle."""

    def __init__(self) -> None:
        self.socket, self._sink = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._drain, self.pipe = os.pipe()
        os.set_blocking(self._drain, False)

    @property
    def fds(self) -> tuple[int, int, int, int]:
        """Both ends of the socket, and the pipe's to write and to read."""
        return self.socket.fileno(), self._sink.fileno(), self.pipe, self._drain

    def drain(self) -> None:
        """Discard the frames and the record of a cycle."""
        with suppress(BlockingIOError):
            while True:
                self._sink.recv(64, socket.MSG_DONTWAIT)
        with suppress(BlockingIOError):
            os.read(self._drain, 1 << 16)

    def close(self) -> None:
        """Close the sockets and the pipes of the benchmark."""
        self.socket.close()
        self._sink.close()
        os.close(self._drain)
        os.close(self.pipe)


class _Recording(Observer):
    """An observer that copies every cycle into a pipe, as the recorder does."""

    def __init__(self, pipe: int, legs: tuple[str, ...]) -> None:
        self._pipe = CyclePipe(pipe, {"legs": ",".join(legs)}, blocking=False)

    def observe(self, cycle: Cycle) -> None:
        """Copy the forces of one cycle."""
        self._pipe.send(cycle)


class OurCycle(NamedTuple):
    """One cycle of the service's pipeline and outputs.

    Attributes:
        run: Processes a scan at a time [ns].
        baseline_pf: Returns the baselines at the start of the next cycle [pF], shape (legs, 9).
        counters: File of its metrics.
        loopback: Receiver of its frames and records.
    """

    run: Callable[[CapFrame, int], Cycle]
    baseline_pf: Callable[[], NDArray[np.float64]]
    counters: Path
    loopback: Loopback


@contextmanager
def our_cycle() -> Iterator[OurCycle]:
    """Compose the cycle of the service.

    Yields:
        The cycle; its counters exist until the end.
    """
    clock, loopback = VirtualClock(), Loopback()
    pipeline = pipeline_for(load_models(DEFAULT), Flag.SIMULATED)
    wire = SocketWire(loopback.socket, lambda: None)
    with (
        TemporaryDirectory(dir="/dev/shm") as folder,
        can_sink(DEFAULT, clock, None, connect=lambda: wire) as sink,
    ):
        counters = Path(folder) / "counters"
        metrics = MetricsObserver(DEFAULT.legs, sink.stats, counters)
        observers = (
            Journal(DEFAULT.legs),
            SystemdObserver(DEFAULT.legs, {}),
            metrics,
            _Recording(loopback.pipe, DEFAULT.legs),
        )

        loop = Loop(pipeline, sink, observers, clock)

        def run(scan: CapFrame, now_ns: int) -> Cycle:
            clock.sleep_until_ns(now_ns)
            return loop.step(scan, tuple(sink.commands()))

        try:
            yield OurCycle(run, lambda: pipeline.baseline_pf, counters, loopback)
        finally:
            metrics.close()
    loopback.close()


def recorded_scans(n: int) -> list[CapFrame]:
    """Return scans of six walking legs in turn."""
    with open_scan_source(DEFAULT, replace(load_scene("measured_walk"), host_cost_us=40.0)) as scan_source:
        return [scan_source.source.read() for _ in range(n)]


def sent_ns(scan: CapFrame) -> int:
    """Return the time of sending the forces of a scan [ns]: 2 ms after the last reading of the scan."""
    return int(scan.t_ns.max()) + 2_000_000


def tared_floor(folder: Path, scans: list[CapFrame]) -> CFloor:
    """Return the C floor, tared with the first scans as the service does.

    Raises:
        FootsenseError: It cannot be compiled.
    """
    floor = CFloor(folder, DEFAULT, load_models(DEFAULT).network.card.trained_inputs)
    floor.tare(np.mean([scan.capacitance_pf for scan in scans[: DEFAULT.tare.window_scans]], axis=0))
    return floor


class _Times(NamedTuple):
    """Duration of every cycle of each program [ns]."""

    ours_ns: list[int]
    floor_ns: list[int]
    naive_ns: list[int]


def cycle_figures(scans: list[CapFrame]) -> dict[str, Any]:
    """Return the durations of a cycle [us] and their ratios; None without the C floor or the naive program.

    Hot: cycles of one program in a row. Cold: each after a cycle of the naive program, which evicts the caches as the
    rest of a robot's software does.

    Args:
        scans: Scans to process; the first `WARM_UP` do not count.

    Raises:
        FootsenseError: The forces of the C floor are not ours.
    """
    return {**_figures(scans, _RUN), "cold": _figures(scans, 1)}


def _figures(scans: list[CapFrame], run: int) -> dict[str, float | None]:
    with TemporaryDirectory() as folder, our_cycle() as ours, naive_cycle(DEFAULT) as naive:
        floor = tared_floor(Path(folder), scans) if has_c_floor() else None
        with gc_disabled(), fifo_priority(PRIORITY):
            times = _time(scans, run, ours, floor, naive)
    ours_us, floor_us, naive_us = (np.array(part[WARM_UP:]) * 1e-3 for part in times)
    p50 = float(np.median(ours_us))
    c_floor_p50, naive_p50 = (float(np.median(us)) if len(us) else None for us in (floor_us, naive_us))
    return {
        "p50": p50,
        "p99": float(np.quantile(ours_us, 0.99)),
        "c_floor_p50": c_floor_p50,
        "naive_p50": naive_p50,
        "cycle_over_c_floor": p50 / c_floor_p50 if c_floor_p50 else None,
        "naive_over_cycle": naive_p50 / p50 if naive_p50 else None,
    }


def _time(
    scans: list[CapFrame], run: int, ours: OurCycle, floor: CFloor | None, naive: NaiveCycle | None
) -> _Times:
    """Time the cycles of three programs in alternating runs, so that background load affects all equally."""
    times = _Times([], [], [])
    loopback = ours.loopback
    for first in range(0, len(scans), run):
        done = []
        for scan in scans[first : first + run]:
            now_ns, baseline_pf = sent_ns(scan), ours.baseline_pf()
            start_ns = stopwatch_ns()
            cycle = ours.run(scan, now_ns)
            times.ours_ns.append(stopwatch_ns() - start_ns)
            loopback.drain()
            # Keep nothing else of the cycle: the service keeps none, and new memory is cold.
            valid = cycle.forces.state == State.VALID
            done.append((scan, now_ns, baseline_pf, cycle.forces.force_n[valid], valid))
            del cycle
        for number, (scan, now_ns, baseline_pf, ours_n, valid) in enumerate(done, first):
            if floor is None:
                break
            codes = codes_of(scan)
            floor.tare(baseline_pf)
            start_ns = stopwatch_ns()
            force_n = floor.run(scan, codes, now_ns, loopback.socket.fileno(), loopback.pipe)
            times.floor_ns.append(stopwatch_ns() - start_ns)
            loopback.drain()
            if number >= WARM_UP:
                _check_same(scan, ours_n, force_n, valid)
        for scan, now_ns, *_ in done:
            if naive is None:
                break
            start_ns = stopwatch_ns()
            naive.run(scan, now_ns, loopback.socket, loopback.pipe)
            times.naive_ns.append(stopwatch_ns() - start_ns)
            loopback.drain()
    return times


def _check_same(
    scan: CapFrame,
    ours_n: NDArray[np.float64],
    floor_n: NDArray[np.float64] | None,
    valid: NDArray[np.bool_],
) -> None:
    """Check that the C floor gives our forces.

    Args:
        scan: The scan.
        ours_n: Our forces of the valid legs [N], shape (valid legs, 3).
        floor_n: Forces of the C floor [N], shape (legs, 3); None without.
        valid: Validity of each leg, shape (legs,).

    Raises:
        FootsenseError: It gives other forces, or none.
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
