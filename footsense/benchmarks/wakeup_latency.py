"""The part of `footsense benchmark` about time: how late the loop wakes at 500 Hz, beside a loop in C in the same run.

    python -m footsense.benchmarks.wakeup_latency ours|c FOLDER

Each loop is a process of its own with the scheduling that the service asks for. It does a whole cycle after every
deadline, ours with its metrics shown by their exporter and scraped over HTTP. The two run in turns, block by block,
first on a quiet machine, then beside two processes that never rest.
"""

import contextlib
import itertools
import json
import logging
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footsense.benchmarks.c_floor import compiler, round_ns
from footsense.benchmarks.cycle import PRIORITY, WARM_UP, Outlets, our_cycle, sent_ns, tared_floor
from footsense.clock import MonotonicClock, request_realtime, undisturbed
from footsense.errors import FootsenseError
from footsense.frames import CapFrame

__all__ = ["jitter_figures"]

_PERIOD_NS = 2_000_000
_SCANS = "scans.npz"
_BLOCKS = 4
_SCRAPE_PERIOD_S = 0.2
_SPIN = "while True: pass"

_Late = NDArray[np.int64]


def jitter_figures(scans: list[CapFrame], seconds: float) -> dict[str, Any]:
    """Return how late the loops woke [us], median and tails, and the ratios of the tails.

    Args:
        scans: What to play, those of the tare first.
        seconds: How long each loop runs in each of the two cases [s].

    Raises:
        FootsenseError: A loop did not run.
    """
    n = max(1, round(seconds * 1e9 / _PERIOD_NS / _BLOCKS))
    names = ("ours", "c") if compiler() else ("ours",)
    figures: dict[str, Any] = {}
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        _write(folder / _SCANS, scans)
        loops = {name: stack.enter_context(_loop(name, folder)) for name in names}
        stack.enter_context(_scraped(loops["ours"].port))
        figures["fifo"] = not loops["ours"].refusals
        figures["not_granted"] = loops["ours"].refusals
        for case in ("quiet", "loaded"):
            if case == "loaded":
                for _ in range(2):
                    stack.enter_context(_busy())
            late_ns: dict[str, list[_Late]] = {name: [] for name in names}
            for _ in range(_BLOCKS):
                for name in names:
                    late_ns[name].append(loops[name].run(n))
            figures[case] = _figures({name: np.concatenate(blocks) for name, blocks in late_ns.items()})
    return figures


def _figures(late_ns: dict[str, _Late]) -> dict[str, Any]:
    tails = {
        name: dict(
            zip(("p50", "p99", "p999"), (np.quantile(late, (0.5, 0.99, 0.999)) * 1e-3).tolist(), strict=True)
        )
        for name, late in late_ns.items()
    }
    ours, c = tails["ours"]["p999"], tails.get("c", {}).get("p999")
    return {"ours": ours, "c": c, "ratio": ours / c if c else None, "tails": tails}


def _write(file: Path, scans: list[CapFrame]) -> None:
    np.savez(
        file,
        t_ns=np.stack([scan.t_ns for scan in scans]),
        capacitance_pf=np.stack([scan.capacitance_pf for scan in scans]),
        reading=np.stack([scan.reading for scan in scans]),
    )


def _read(file: Path) -> list[CapFrame]:
    with np.load(file) as arrays:
        columns = zip(arrays["t_ns"], arrays["capacitance_pf"], arrays["reading"], strict=True)
        return [CapFrame(number, *parts) for number, parts in enumerate(columns)]


class _Loop:
    """A loop in a process of its own that waits until it is asked to run.

    Attributes:
        port: Where its metrics are shown; 0 for none.
        refusals: What it was not granted.
    """

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        first = self._answer()
        self.port: int = first["port"]
        self.refusals: list[str] = first["refusals"]

    def run(self, n: int) -> _Late:
        """Let it do `n` cycles; return how late each began [ns]."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{n}\n")
        self._process.stdin.flush()
        return np.array(self._answer()["late_ns"], np.int64)

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise FootsenseError(f"a loop of the bench ended by itself (exit code {self._process.wait()})")
        answer: dict[str, Any] = json.loads(line)
        return answer


@contextlib.contextmanager
def _loop(name: str, folder: Path) -> Iterator[_Loop]:
    with subprocess.Popen(  # noqa: S603 - our own module
        [sys.executable, "-P", "-m", "footsense.benchmarks.wakeup_latency", name, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        yield _Loop(process)


@contextlib.contextmanager
def _busy() -> Iterator[None]:
    with subprocess.Popen([sys.executable, "-S", "-c", _SPIN]) as process:  # noqa: S603 - our own line
        try:
            yield
        finally:
            process.kill()


@contextlib.contextmanager
def _scraped(port: int) -> Iterator[None]:
    """Read the metrics again and again, as Prometheus does, but more often."""
    over = threading.Event()

    def scrape() -> None:
        while not over.wait(_SCRAPE_PERIOD_S):
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as answer:
                answer.read()

    thread = threading.Thread(target=scrape)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


# ---------------------------------------------------------------- the loops, each in its process


def _say(answer: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


def _rounds(played: list[tuple[CapFrame, int]]) -> Iterator[tuple[CapFrame, int]]:
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
    """Run `footsense exporter`; yield its port."""  # noqa: DOC402 - one line
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


def _serve_ours(scans: list[CapFrame]) -> None:
    with our_cycle() as cycle, _exporter(cycle.counters) as port:
        refusals = request_realtime(PRIORITY, None)
        for scan in scans[:WARM_UP]:
            cycle.run(scan, sent_ns(scan))
            cycle.outlets.drain()
        _say({"port": port, "refusals": refusals})
        clock = MonotonicClock()
        rounds = _rounds([(scan, sent_ns(scan)) for scan in scans[WARM_UP:]])
        for line in sys.stdin:
            late_ns = [0] * int(line)
            with undisturbed():
                deadline_ns = clock.now_ns()
                for i in range(len(late_ns)):
                    # The next one that is still to come: what was missed is not made up for.
                    deadline_ns += _PERIOD_NS * max(1, 1 + (clock.now_ns() - deadline_ns) // _PERIOD_NS)
                    clock.sleep_until_ns(deadline_ns)
                    late_ns[i] = clock.now_ns() - deadline_ns
                    cycle.run(*next(rounds))
                    cycle.outlets.drain()
            _say({"late_ns": late_ns})


def _serve_c(scans: list[CapFrame], folder: Path) -> None:
    floor, outlets = tared_floor(folder, scans), Outlets()
    _say({"port": 0, "refusals": request_realtime(PRIORITY, None)})
    played = [(scan, sent_ns(scan)) for scan in scans[WARM_UP:]]
    for line in sys.stdin:
        _say({"late_ns": floor.pace(_PERIOD_NS, played, int(line), outlets.fds).tolist()})


def main() -> int:
    """Run the loop that the command line names, as often as standard input asks; return the exit code."""
    name, folder = sys.argv[1:]
    logging.getLogger().addHandler(logging.NullHandler())  # a walk that begins anew is a jump, and no news
    scans = _read(Path(folder) / _SCANS)
    if name == "ours":
        _serve_ours(scans)
    else:
        _serve_c(scans, Path(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
