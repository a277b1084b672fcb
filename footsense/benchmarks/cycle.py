"""One cycle of the service on recorded readings, timed in turns with a naive program for the same work.

A whole cycle: estimate, publish, write into the ring. It sends to a socket pair, which stands for CAN on any machine
and is drained between cycles.
"""

import os
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from footsense.benchmarks.naive import NaiveCycle, has_cantools
from footsense.clock import stopwatch_ns
from footsense.config import DEFAULT, Config
from footsense.config.sections import Realtime
from footsense.daemon.acquisition import open_scan_source
from footsense.daemon.can_output import can_sink
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.loop import Loop
from footsense.daemon.models import load_models
from footsense.daemon.recording_header import recording_header
from footsense.daemon.scheduling import fifo_priority, low_latency_interpreter
from footsense.estimation.network import Network, steady_windows
from footsense.frames import ELEMENTS, CapFrame, Flag
from footsense.ring.cycle_ring import CycleRing
from footsense.ring.records import ServiceStatus
from footsense.sim.clock import VirtualClock
from footsense.sim.scene import load_scene
from footsense.telemetry.systemd import LegStateLogger, SystemdNotifier
from footsense.wires.socket_wire import SocketWire

#: Priority of SCHED_FIFO, the default of the service; without it the figures include other processes.
REALTIME_PRIORITY = Realtime().priority
#: Cycles at the begin, in which the feet are tared.
N_WARM_UP_CYCLES = 120
#: Cycles in a row of one program before the turn of the next.
_CYCLES_BEFORE_NEXT_PROGRAM = 25
#: Time from the newest reading of a frame until its forces are sent [ns].
_SEND_DELAY_NS = 2_000_000


class ServiceCycle(NamedTuple):
    """One cycle of the daemon's pipeline and outputs, ready to run.

    Attributes:
        run: Processes a frame at a time [ns].
        drain: Reads and discards what the cycle has sent.
        ring: The ring that it writes.
        channel: Socket in place of CAN.
    """

    run: Callable[[CapFrame, int], object]
    drain: Callable[[], None]
    ring: Path
    channel: socket.socket


@contextmanager
def open_service_cycle(config: Config = DEFAULT, *, publish_every: int = 1) -> Iterator[ServiceCycle]:
    """Set up one cycle of the daemon (pipeline, CAN sink, observers) with a socket pair in place of CAN.

    Args:
        config: The robot.
        publish_every: Cycles per force on CAN, in place of its own: with 1 each cycle does all the work.

    Yields:
        The cycle; its ring exists until the end.
    """
    channel, far_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    clock, wire = VirtualClock(), SocketWire(channel)
    models = load_models(replace(config, publish_every=publish_every))
    pipeline = pipeline_for(models, Flag.SIMULATED)
    with (
        far_end,
        TemporaryDirectory(dir="/dev/shm") as folder,
        can_sink(models, clock, None, lambda: wire) as sink,
    ):
        ring = Path(folder) / "ring"
        header = recording_header(models, None, Flag.SIMULATED, clock.now_ns())

        def status() -> ServiceStatus:
            return ServiceStatus(can=sink.stats, baseline=pipeline.baseline_pf.tobytes())

        observers = (
            LegStateLogger(config.legs),
            SystemdNotifier(config.legs, {}),
            CycleRing(ring, config.legs, header, config.frames_hz, status),
        )
        loop = Loop(pipeline, sink, observers, clock)

        def run(scan: CapFrame, now_ns: int) -> None:
            clock.sleep_until_ns(now_ns)
            loop.run_cycle(scan, tuple(sink.commands()), motion=sink.new_motion())

        def drain() -> None:
            with suppress(BlockingIOError):
                while True:
                    far_end.recv(64, socket.MSG_DONTWAIT)

        try:
            yield ServiceCycle(run, drain, ring, channel)
        finally:
            for observer in observers:
                observer.close()


def simulated_walk_frames(n: int, config: Config = DEFAULT) -> list[CapFrame]:
    """Return the simulated capacitance frames of `n` conversions of six walking legs."""
    with open_scan_source(config, replace(load_scene("measured_walk"), host_cost_us=40.0)) as scan_source:
        return [scan_source.source.read() for _ in range(n)]


def send_time_ns(scan: CapFrame) -> int:
    """Return the sending time assumed for a frame's forces [ns]."""
    return int(scan.t_ns.max()) + _SEND_DELAY_NS


def compare_cycle_durations(scans: list[CapFrame], config: Config = DEFAULT) -> dict[str, float | None]:
    """Return quantiles of the cycle durations of daemon and naive program [us], and their ratio.

    Args:
        scans: Frames to process; the first `N_WARM_UP_CYCLES` do not count.
        config: The robot that they are of.

    Returns:
        `p50`, `p99`, and `naive_p50`, `naive_over_cycle`, which are None where cantools is not installed.
    """
    naive = NaiveCycle(config) if has_cantools() else None
    ours_ns: list[int] = []
    naive_ns: list[int] = []
    with (
        open_service_cycle(config) as ours,
        Path(os.devnull).open("wb") as record,
        low_latency_interpreter(),
        fifo_priority(REALTIME_PRIORITY),
    ):
        for first in range(0, len(scans), _CYCLES_BEFORE_NEXT_PROGRAM):
            turn = [(scan, send_time_ns(scan)) for scan in scans[first : first + _CYCLES_BEFORE_NEXT_PROGRAM]]
            for scan, now_ns in turn:
                start_ns = stopwatch_ns()
                ours.run(scan, now_ns)
                ours_ns.append(stopwatch_ns() - start_ns)
                ours.drain()
            for scan, now_ns in turn:
                if naive is None:
                    break
                start_ns = stopwatch_ns()
                naive.run(scan, now_ns, ours.channel, record.fileno())
                naive_ns.append(stopwatch_ns() - start_ns)
                ours.drain()
    ours_us, naive_us = (np.array(times[N_WARM_UP_CYCLES:]) * 1e-3 for times in (ours_ns, naive_ns))
    p50, naive_p50 = float(np.median(ours_us)), float(np.median(naive_us)) if naive else None
    return {
        "p50": p50,
        "p99": float(np.quantile(ours_us, 0.99)),
        "naive_p50": naive_p50,
        "naive_over_cycle": naive_p50 / p50 if naive_p50 else None,
    }


def network_durations_us(networks: Sequence[Path], n_legs: int, n_calls: int) -> list[float]:
    """Return the median duration of a call of each network as the service makes it, on one thread [us].

    Args:
        networks: ONNX files with a card; they take turns, so that what else the machine does costs all alike.
        n_legs: Legs in a call.
        n_calls: Calls of each.
    """
    opened = [Network(path, n_legs) for path in networks]
    window = steady_windows(np.zeros((n_legs, ELEMENTS)))
    times_ns: list[list[int]] = [[] for _ in opened]
    with low_latency_interpreter(), fifo_priority(REALTIME_PRIORITY):
        for _ in range(0, n_calls, _CYCLES_BEFORE_NEXT_PROGRAM):
            for network, own_ns in zip(opened, times_ns, strict=True):
                for _ in range(_CYCLES_BEFORE_NEXT_PROGRAM):
                    start_ns = stopwatch_ns()
                    network.estimate(window)
                    own_ns.append(stopwatch_ns() - start_ns)
    return [1e-3 * float(np.median(own_ns)) for own_ns in times_ns]
