"""Wake-up latency of the main loop at 500 Hz, on a quiet machine and beside two processes that never rest.

The loop is a process of its own with the scheduling of the service. It runs a whole cycle after every deadline, with
its metrics shown by their exporter and scraped over HTTP.

Simulated buses are read in turn, real ones side by side, in threads. What threads add to a frame does not depend on
what a bus does: to hand over a read to each, and to wait for both.
"""

import contextlib
import itertools
import logging
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Iterator
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from footsense.acquisition.robot_scanner import RobotScanner
from footsense.acquisition.scan_plan import AD7147_PLAN
from footsense.benchmarks.cycle import (
    N_WARM_UP_CYCLES,
    ServiceCycle,
    open_service_cycle,
    send_time_ns,
)
from footsense.clock import MonotonicClock, stopwatch_ns
from footsense.config.sections import Realtime
from footsense.daemon.scheduling import fifo_priority, low_latency_interpreter, request_realtime
from footsense.errors import FootsenseError
from footsense.frames import ELEMENTS, CapFrame

if TYPE_CHECKING:
    from footsense.acquisition.free_scanner import FreeScanner

_PERIOD_NS = 2_000_000
_SCRAPE_PERIOD_S = 0.2
_BUSY_LOOP = (sys.executable, "-S", "-c", "while True: pass")
#: Buses whose threads are timed, frames before that, and legs and elements of a bus.
_N_BUSES, _N_WARM_UP = 2, 50
_SHAPE = 3, ELEMENTS
_QUANTILES = {"p50": 0.5, "p99": 0.99, "p999": 0.999}


def measure_wakeup_latency(scans: list[CapFrame], seconds: float) -> dict[str, Any]:
    """Return the wake-up latencies of the daemon's loop, and what scheduling was not granted.

    Args:
        scans: Frames to process, those of the tare first.
        seconds: Run time in each of the two cases [s].

    Returns:
        `quiet` and `loaded`, each with the quantiles `p50`, `p99`, `p999` [us], and `not_granted`.

    Raises:
        FootsenseError: The loop ended by itself.
    """
    n = max(1, round(seconds * 1e9 / _PERIOD_NS))
    with contextlib.ExitStack() as stack:
        loop = stack.enter_context(_loop_process(scans))
        port, refusals = _answer(loop)
        over = threading.Event()
        scraper = threading.Thread(target=_scrape_repeatedly, args=(port, over))
        scraper.start()
        stack.callback(scraper.join)
        stack.callback(over.set)
        figures: dict[str, Any] = {"not_granted": refusals}
        for case in ("quiet", "loaded"):
            for _ in range(2 if case == "loaded" else 0):
                busy = stack.enter_context(subprocess.Popen(_BUSY_LOOP))  # noqa: S603 - our own words
                stack.callback(busy.kill)
            loop.send(n)
            late_us = np.array(_answer(loop)) * 1e-3
            figures[case] = {name: float(np.quantile(late_us, q)) for name, q in _QUANTILES.items()}
    return figures


@contextlib.contextmanager
def _loop_process(scans: list[CapFrame]) -> Iterator[Connection]:
    context = get_context("spawn")
    connection, theirs = context.Pipe()
    process = context.Process(target=_run_loop, args=(theirs, scans))
    process.start()
    theirs.close()
    try:
        yield connection
    finally:
        connection.close()
        process.join()


def _answer(loop: Connection) -> Any:  # noqa: ANN401 - what the loop sends
    try:
        return loop.recv()
    except EOFError:
        raise FootsenseError("the loop of the benchmark ended by itself") from None


def _scrape_repeatedly(port: int, over: threading.Event) -> None:
    """Read the metrics over HTTP repeatedly, as Prometheus does but more often, until `over` is set."""
    while not over.wait(_SCRAPE_PERIOD_S):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as answer:
            answer.read()


def _run_loop(connection: Connection, scans: list[CapFrame]) -> None:
    """Answer with the exporter's port and what was refused, then each number of cycles with their latencies [ns]."""
    logging.disable()  # a walk that begins anew is reported as a jump
    with open_service_cycle() as cycle, _exporter(cycle.ring) as port, contextlib.suppress(EOFError):
        refusals = request_realtime(Realtime().priority)
        for scan in scans[:N_WARM_UP_CYCLES]:
            cycle.run(scan, send_time_ns(scan))
            cycle.drain()
        connection.send((port, refusals))
        walk = _repeated(scans[N_WARM_UP_CYCLES:])
        while True:
            connection.send(_wakeup_latencies_ns(cycle, walk, connection.recv()))


def _wakeup_latencies_ns(cycle: ServiceCycle, walk: Iterator[tuple[CapFrame, int]], n: int) -> list[int]:
    clock, late_ns = MonotonicClock(), [0] * n
    with low_latency_interpreter():
        deadline_ns = clock.now_ns()
        for i in range(n):
            # The next deadline that is still to come: missed ones are not made up for.
            deadline_ns += _PERIOD_NS * max(1, 1 + (clock.now_ns() - deadline_ns) // _PERIOD_NS)
            clock.sleep_until_ns(deadline_ns)
            late_ns[i] = clock.now_ns() - deadline_ns
            cycle.run(*next(walk))
            cycle.drain()
    return late_ns


def _repeated(scans: list[CapFrame]) -> Iterator[tuple[CapFrame, int]]:
    """Yield frames in endless repetition, each with its time of sending [ns]; times keep increasing."""
    times_ns = [send_time_ns(scan) for scan in scans]
    once_ns = times_ns[-1] - times_ns[0] + times_ns[1] - times_ns[0]
    for later_ns in itertools.count(0, once_ns):
        for scan, now_ns in zip(scans, times_ns, strict=True):
            yield scan._replace(t_ns=scan.t_ns + later_ns), now_ns + later_ns


@contextlib.contextmanager
def _exporter(ring: Path) -> Iterator[int]:
    """Run `footsense exporter` in a child process during a `with` block; yield its port."""  # noqa: DOC402 - one line
    with subprocess.Popen(  # noqa: S603 - our own module
        [sys.executable, "-P", "-m", "footsense", "exporter", "--ring", str(ring), "--port", "0"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        try:
            yield int(process.stdout.readline().rpartition(":")[2].partition("/")[0])
        finally:
            process.terminate()


class _ReadyBus:
    """A bus that answers at once."""

    latest = CapFrame(0, np.ones(_SHAPE, np.int64), np.ones(_SHAPE), np.zeros(_SHAPE, np.uint8))
    plan = AD7147_PLAN

    def __init__(self) -> None:
        self._clock, self.complete_ns = MonotonicClock(), 0

    def read(self) -> CapFrame:
        """Return readings."""
        self.complete_ns = self._clock.now_ns()
        return self.latest

    def close(self) -> None:
        """Do nothing."""


def measure_threads(n_frames: int) -> dict[str, float]:
    """Return the median time of a frame of two buses that answer at once [us].

    Args:
        n_frames: Frames to time in each way.

    Returns:
        `in_turn`, `in_threads`, and `added`, their difference.
    """
    in_turn, in_threads = (_frame_us(n_frames, threads=threads) for threads in (False, True))
    return {"in_turn": in_turn, "in_threads": in_threads, "added": in_threads - in_turn}


def _frame_us(n_frames: int, *, threads: bool) -> float:
    buses = cast("list[FreeScanner]", [_ReadyBus() for _ in range(_N_BUSES)])
    with low_latency_interpreter(), fifo_priority(Realtime().priority):
        scanner = RobotScanner(buses, threads=threads)  # its threads inherit the priority
        times_ns = []
        for _ in range(_N_WARM_UP + n_frames):
            start_ns = stopwatch_ns()
            scanner.read()
            times_ns.append(stopwatch_ns() - start_ns)
        scanner.close()
    return 1e-3 * float(np.median(times_ns[_N_WARM_UP:]))
