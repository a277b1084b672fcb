"""Part of `footsense benchmark`: wake-up latency of the main loop at 500 Hz, beside a loop in C in the same run.

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

from footsense.benchmarks.c_program import has_c_program, scan_sequence_duration_ns
from footsense.benchmarks.our_cycle import (
    N_WARM_UP_CYCLES,
    REALTIME_PRIORITY,
    Loopback,
    ServiceCycle,
    open_service_cycle,
    send_time_ns,
    tared_c_program,
)
from footsense.clock import MonotonicClock, low_latency_interpreter, request_realtime
from footsense.errors import FootsenseError
from footsense.frames import CapFrame

#: Period of the loop [ns].
PERIOD_NS = 2_000_000
_N_ALTERNATIONS = 4
_SCRAPE_PERIOD_S = 0.2
_BUSY_LOOP_CODE = "while True: pass"
_QUANTILES = {"p50": 0.5, "p99": 0.99, "p999": 0.999}

#: A loop: answers each number of cycles with the latency of each [ns], after a first answer with port and refusals.
_Serve = Callable[[Connection, list[CapFrame]], None]


def measure_wakeup_latency(scans: list[CapFrame], seconds: float) -> dict[str, Any]:
    """Return the wake-up latencies of the daemon's loop and of the C loop [us], and their ratios.

    Args:
        scans: Scans to process, those of the tare first.
        seconds: Run time of each loop in each of the two cases [s].

    Raises:
        FootsenseError: A loop ended by itself.
    """
    n = max(1, round(seconds * 1e9 / PERIOD_NS / _N_ALTERNATIONS))
    serve: dict[str, _Serve] = {"ours": _run_service_loop} | ({"c": _run_c_loop} if has_c_program() else {})
    figures: dict[str, Any] = {}
    with contextlib.ExitStack() as stack:
        loops = {name: stack.enter_context(run_loop_process(target, scans)) for name, target in serve.items()}
        (port, refusals), *_ = [wait_for_answer(loop) for loop in loops.values()]
        over = threading.Event()
        scraper = threading.Thread(target=_scrape_repeatedly, args=(port, over))
        scraper.start()
        stack.callback(scraper.join)
        stack.callback(over.set)
        figures["fifo"] = not refusals
        figures["not_granted"] = refusals
        for case in ("quiet", "loaded"):
            if case == "loaded":
                for _ in range(2):
                    command = [sys.executable, "-S", "-c", _BUSY_LOOP_CODE]
                    busy = stack.enter_context(subprocess.Popen(command))  # noqa: S603
                    stack.callback(busy.kill)
            wakeup_latencies_ns: dict[str, list[int]] = {name: [] for name in loops}
            for _, (name, loop) in itertools.product(range(_N_ALTERNATIONS), loops.items()):
                loop.send(n)
                wakeup_latencies_ns[name] += wait_for_answer(loop)
            figures[case] = _latency_quantiles_and_ratio(wakeup_latencies_ns)
    return figures


def _latency_quantiles_and_ratio(wakeup_latencies_ns: dict[str, list[int]]) -> dict[str, Any]:
    """Return the latency quantiles of both loops [us], and the ratios of the tails."""
    tails = latency_tails(wakeup_latencies_ns)
    ours, c = tails["ours"]["p999"], tails.get("c", {}).get("p999")
    return {"ours": ours, "c": c, "ratio": ours / c if c else None, "tails": tails}


def latency_tails(wakeup_latencies_ns: Mapping[str, list[int]]) -> dict[str, dict[str, float]]:
    """Return median and tail quantiles [us] of each list of latencies [ns]."""
    return {
        name: {tail: float(np.quantile(late, q)) * 1e-3 for tail, q in _QUANTILES.items()}
        for name, late in wakeup_latencies_ns.items()
    }


@contextlib.contextmanager
def run_loop_process(target: _Serve, scans: list[CapFrame]) -> Iterator[Connection]:
    """Run a loop in a child process during a `with` block; closing the connection ends the loop.

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


def wait_for_answer(loop: Connection) -> Any:  # noqa: ANN401 - what the loop sends
    """Wait without limit for the next answer of a loop process, and return it.

    Raises:
        FootsenseError: It ended by itself.
    """
    try:
        return loop.recv()
    except EOFError:
        raise FootsenseError("a loop of the benchmark ended by itself") from None


def _scrape_repeatedly(port: int, over: threading.Event) -> None:
    """Read the metrics over HTTP repeatedly, as Prometheus does but more often, until `over` is set."""
    while not over.wait(_SCRAPE_PERIOD_S):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as answer:
            answer.read()


def _repeat_scans(played: list[tuple[CapFrame, int]]) -> Iterator[tuple[CapFrame, int]]:
    """Yield frames in endless repetition, with times that keep increasing.

    Yields:
        A scan, and when it is processed, in its time [ns].
    """
    for later_ns in itertools.count(0, scan_sequence_duration_ns(played)):
        for scan, now_ns in played:
            yield (
                CapFrame(scan.sequence, scan.t_ns + later_ns, scan.capacitance_pf, scan.reading),
                now_ns + later_ns,
            )


@contextlib.contextmanager
def _run_exporter(ring: Path) -> Iterator[int]:
    """Run `footsense exporter` as a child process during a `with` block; yield its port."""  # noqa: DOC402 - one line
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


def _requested_cycle_counts(connection: Connection) -> Iterator[int]:
    """Yield each number of cycles that the parent process requests, until it closes the connection."""
    with contextlib.suppress(EOFError):
        while True:
            yield connection.recv()


def _run_service_loop(connection: Connection, scans: list[CapFrame]) -> None:
    """Run the daemon's cycle at its period in a child process, and send the wake-up latencies."""
    logging.disable()  # a walk that begins anew is reported as a jump
    with open_service_cycle() as cycle, _run_exporter(cycle.ring) as port:
        refusals = request_realtime(REALTIME_PRIORITY, None)
        run_warm_up_cycles(cycle, scans)
        connection.send((port, refusals))
        answer_paced_cycles(connection, cycle, scans)


def run_warm_up_cycles(cycle: ServiceCycle, scans: list[CapFrame]) -> None:
    """Run the first cycles, in which the feet are tared."""
    for scan in scans[:N_WARM_UP_CYCLES]:
        cycle.run(scan, send_time_ns(scan))
        cycle.loopback.drain()


def answer_paced_cycles(connection: Connection, cycle: ServiceCycle, scans: list[CapFrame]) -> None:
    """Run each requested number of cycles at the loop's period, and send their wake-up latencies [ns]."""
    clock = MonotonicClock()
    rounds = _repeat_scans([(scan, send_time_ns(scan)) for scan in scans[N_WARM_UP_CYCLES:]])
    for n in _requested_cycle_counts(connection):
        wakeup_latencies_ns = [0] * n
        with low_latency_interpreter():
            deadline_ns = clock.now_ns()
            for i in range(n):
                # The next deadline that is still to come: missed ones are not made up for.
                deadline_ns += PERIOD_NS * max(1, 1 + (clock.now_ns() - deadline_ns) // PERIOD_NS)
                clock.sleep_until_ns(deadline_ns)
                wakeup_latencies_ns[i] = clock.now_ns() - deadline_ns
                cycle.run(*next(rounds))
                cycle.loopback.drain()
        connection.send(wakeup_latencies_ns)


def _run_c_loop(connection: Connection, scans: list[CapFrame]) -> None:
    """Run the C loop in a child process, and send its wake-up latencies."""
    with TemporaryDirectory() as folder:
        floor, loopback = tared_c_program(Path(folder), scans), Loopback()
        connection.send((0, request_realtime(REALTIME_PRIORITY, None)))
        played = [(scan, send_time_ns(scan)) for scan in scans[N_WARM_UP_CYCLES:]]
        for n in _requested_cycle_counts(connection):
            connection.send(
                floor.measure_wakeup_latencies_ns(PERIOD_NS, played, n, loopback.file_descriptors).tolist()
            )
