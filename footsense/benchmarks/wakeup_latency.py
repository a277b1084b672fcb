"""Part of `footsense benchmark`: wake-up latency of the loop at 500 Hz, beside a loop in C in the same run.

Each loop is a process of its own with the scheduling of the service. It runs a whole cycle after every deadline, ours
with its metrics shown by their exporter and scraped over HTTP. The two run in turns, block by block, first on a quiet
machine, then beside two processes that never rest.
"""

import contextlib
import itertools
import logging
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from footsense.benchmarks.c_floor import has_c_floor, round_ns
from footsense.benchmarks.our_cycle import (
    PRIORITY,
    WARM_UP,
    Loopback,
    OurCycle,
    our_cycle,
    sent_ns,
    tared_floor,
)
from footsense.clock import MonotonicClock, gc_disabled, request_realtime
from footsense.errors import FootsenseError
from footsense.frames import CapFrame

#: Period of the loop [ns].
PERIOD_NS = 2_000_000
_BLOCKS = 4
_SCRAPE_PERIOD_S = 0.2
_SPIN = "while True: pass"
_QUANTILES = {"p50": 0.5, "p99": 0.99, "p999": 0.999}

#: A loop: answers each number of cycles with the latency of each [ns], after a first answer with port and refusals.
_Serve = Callable[[Connection, list[CapFrame]], None]


def wakeup_latency_figures(scans: list[CapFrame], seconds: float) -> dict[str, Any]:
    """Return the wake-up latency of both loops [us], median and tails, and the ratios of the tails.

    Args:
        scans: Scans to process, those of the tare first.
        seconds: Run time of each loop in each of the two cases [s].

    Raises:
        FootsenseError: A loop ended by itself.
    """
    n = max(1, round(seconds * 1e9 / PERIOD_NS / _BLOCKS))
    serve: dict[str, _Serve] = {"ours": _serve_ours} | ({"c": _serve_c} if has_c_floor() else {})
    figures: dict[str, Any] = {}
    with contextlib.ExitStack() as stack:
        loops = {name: stack.enter_context(child_process(target, scans)) for name, target in serve.items()}
        (port, refusals), *_ = [receive(loop) for loop in loops.values()]
        over = threading.Event()
        scraper = threading.Thread(target=_scrape, args=(port, over))
        scraper.start()
        stack.callback(scraper.join)
        stack.callback(over.set)
        figures["fifo"] = not refusals
        figures["not_granted"] = refusals
        for case in ("quiet", "loaded"):
            if case == "loaded":
                for _ in range(2):
                    busy = stack.enter_context(subprocess.Popen([sys.executable, "-S", "-c", _SPIN]))  # noqa: S603
                    stack.callback(busy.kill)
            late_ns: dict[str, list[int]] = {name: [] for name in loops}
            for _, (name, loop) in itertools.product(range(_BLOCKS), loops.items()):
                loop.send(n)
                late_ns[name] += receive(loop)
            figures[case] = _latency_figures(late_ns)
    return figures


def _latency_figures(late_ns: dict[str, list[int]]) -> dict[str, Any]:
    tails = latency_tails(late_ns)
    ours, c = tails["ours"]["p999"], tails.get("c", {}).get("p999")
    return {"ours": ours, "c": c, "ratio": ours / c if c else None, "tails": tails}


def latency_tails(late_ns: Mapping[str, list[int]]) -> dict[str, dict[str, float]]:
    """Return median and tails [us] of some latencies [ns]."""
    return {
        name: {tail: float(np.quantile(late, q)) * 1e-3 for tail, q in _QUANTILES.items()}
        for name, late in late_ns.items()
    }


@contextlib.contextmanager
def child_process(target: _Serve, scans: list[CapFrame]) -> Iterator[Connection]:
    """Run a loop in a child process, and close the connection to end the loop.

    Yields:
        The connection.
    """
    context = get_context("spawn")
    connection, theirs = context.Pipe()
    process = context.Process(target=target, args=(theirs, scans))
    process.start()
    theirs.close()
    try:
        yield connection
    finally:
        connection.close()
        process.join()


def receive(loop: Connection) -> Any:  # noqa: ANN401 - what the loop sends
    """Return the next answer of a loop.

    Raises:
        FootsenseError: It ended by itself.
    """
    try:
        return loop.recv()
    except EOFError:
        raise FootsenseError("a loop of the benchmark ended by itself") from None


def _scrape(port: int, over: threading.Event) -> None:
    """Read the metrics again and again, as Prometheus does, but more often."""
    while not over.wait(_SCRAPE_PERIOD_S):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as answer:
            answer.read()


def _repeat_scans(played: list[tuple[CapFrame, int]]) -> Iterator[tuple[CapFrame, int]]:
    """Play scans round and round, in ever later times.

    Yields:
        A scan, and when it is processed, in its time [ns].
    """
    for later_ns in itertools.count(0, round_ns(played)):
        for scan, now_ns in played:
            yield (
                CapFrame(scan.sequence, scan.t_ns + later_ns, scan.capacitance_pf, scan.reading),
                now_ns + later_ns,
            )


@contextlib.contextmanager
def _exporter(counters: Path) -> Iterator[int]:
    """Run `footsense exporter` as a child process, and yield the port it serves."""  # noqa: DOC402 - one line
    with subprocess.Popen(  # noqa: S603 - our own module
        [sys.executable, "-P", "-m", "footsense", "exporter", "--counters", str(counters), "--port", "0"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        try:
            yield int(process.stdout.readline().rpartition(":")[2].partition("/")[0])
        finally:
            process.terminate()


def _requests(connection: Connection) -> Iterator[int]:
    """Yield each requested number of cycles until the peer closes the connection."""
    with contextlib.suppress(EOFError):
        while True:
            yield connection.recv()


def _serve_ours(connection: Connection, scans: list[CapFrame]) -> None:
    logging.disable()  # a walk that begins anew is reported as a jump
    with our_cycle() as cycle, _exporter(cycle.counters) as port:
        refusals = request_realtime(PRIORITY, None)
        warm_up(cycle, scans)
        connection.send((port, refusals))
        paced_blocks(connection, cycle, scans)


def warm_up(cycle: OurCycle, scans: list[CapFrame]) -> None:
    """Run the cycles in which the feet are tared."""
    for scan in scans[:WARM_UP]:
        cycle.run(scan, sent_ns(scan))
        cycle.loopback.drain()


def paced_blocks(connection: Connection, cycle: OurCycle, scans: list[CapFrame]) -> None:
    """Answer each number of cycles with the wake-up latency of each [ns], until the peer closes the connection."""
    clock = MonotonicClock()
    rounds = _repeat_scans([(scan, sent_ns(scan)) for scan in scans[WARM_UP:]])
    for n in _requests(connection):
        late_ns = [0] * n
        with gc_disabled():
            deadline_ns = clock.now_ns()
            for i in range(n):
                # The next deadline that is still to come: missed ones are not made up for.
                deadline_ns += PERIOD_NS * max(1, 1 + (clock.now_ns() - deadline_ns) // PERIOD_NS)
                clock.sleep_until_ns(deadline_ns)
                late_ns[i] = clock.now_ns() - deadline_ns
                cycle.run(*next(rounds))
                cycle.loopback.drain()
        connection.send(late_ns)


def _serve_c(connection: Connection, scans: list[CapFrame]) -> None:
    with TemporaryDirectory() as folder:
        floor, loopback = tared_floor(Path(folder), scans), Loopback()
        connection.send((0, request_realtime(PRIORITY, None)))
        played = [(scan, sent_ns(scan)) for scan in scans[WARM_UP:]]
        for n in _requests(connection):
            connection.send(floor.pace(PERIOD_NS, played, n, loopback.fds).tolist())
