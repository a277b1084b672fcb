"""Part of `footsense benchmark`: wake-up latency of the main loop with and without viewers of its web page.

The loop is a process of its own with the scheduling of the service, and copies every cycle into shared memory. Another
process serves the page to one viewer that draws everything, and to five clients that connect and read nothing more. It
is stopped and continued in turns, block by block: both figures come from one run.
"""

import contextlib
import itertools
import json
import logging
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from websockets.sync.client import connect
from websockets.typing import Subprotocol

from footsense.benchmarks.our_cycle import REALTIME_PRIORITY, open_service_cycle
from footsense.benchmarks.wakeup_latency import (
    PERIOD_NS,
    answer_paced_cycles,
    latency_tails,
    run_loop_process,
    run_warm_up_cycles,
    wait_for_answer,
)
from footsense.clock import request_realtime
from footsense.frames import CapFrame

_N_ALTERNATIONS = 4
_N_STALLED_CLIENTS = 5
_PAGE, _FOXGLOVE = Subprotocol("footsense.view.v1"), Subprotocol("foxglove.websocket.v1")
#: More channels than there are: one client of Foxglove's protocol subscribes to all topics.
_N_CHANNELS = 20


def measure_viewed_latency(scans: list[CapFrame], seconds: float) -> dict[str, Any]:
    """Return the loop's wake-up latency without and with viewers [us], and the ratio of the 99th percentiles.

    Args:
        scans: Scans to process, those of the tare first.
        seconds: Run time of each of the two cases [s].

    Raises:
        FootsenseError: The loop ended by itself.
    """
    n = max(1, round(seconds * 1e9 / PERIOD_NS / _N_ALTERNATIONS))
    wakeup_latencies_ns: dict[str, list[int]] = {"alone": [], "viewed": []}
    with run_loop_process(_run_shared_service_loop, scans) as loop:
        ring, refusals = wait_for_answer(loop)
        with _run_viewer(Path(ring)) as (viewer, host), _connect_clients(host):
            for _, (case, do) in itertools.product(
                range(_N_ALTERNATIONS), (("alone", signal.SIGSTOP), ("viewed", signal.SIGCONT))
            ):
                viewer.send_signal(do)
                loop.send(n)
                wakeup_latencies_ns[case] += wait_for_answer(loop)
    tails = latency_tails(wakeup_latencies_ns)
    return {"fifo": not refusals, "tails": tails, "ratio": tails["viewed"]["p99"] / tails["alone"]["p99"]}


def _run_shared_service_loop(connection: Connection, scans: list[CapFrame]) -> None:
    """Run the daemon's cycle in a child process, with its cycles shared with viewers."""
    logging.disable()  # a walk that begins anew is reported as a jump
    with open_service_cycle() as cycle:
        refusals = request_realtime(REALTIME_PRIORITY, None)
        run_warm_up_cycles(cycle, scans)
        connection.send((str(cycle.ring), refusals))
        answer_paced_cycles(connection, cycle, scans)


@contextlib.contextmanager
def _run_viewer(ring: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run `footsense view` during a `with` block; yield its process and its host and port."""  # noqa: DOC402 - one line
    command = ["-P", "-m", "footsense", "view", "--ring", str(ring), "--port", "0"]
    with subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        assert process.stdout is not None
        try:
            yield process, process.stdout.readline().strip().removeprefix("http://")
        finally:
            process.send_signal(signal.SIGCONT)
            process.terminate()


@contextlib.contextmanager
def _connect_clients(host: str) -> Iterator[None]:
    """Connect to the page during a `with` block: one viewer that reads, and clients that never read."""
    over = threading.Event()
    drawing = threading.Thread(target=_acknowledge_cycles, args=(host, over))
    with contextlib.ExitStack() as stack:
        for number in range(_N_STALLED_CLIENTS):
            protocol = _FOXGLOVE if number % 2 else _PAGE
            slow = stack.enter_context(
                connect(
                    f"ws://{host}/",
                    subprotocols=[protocol],
                    close_timeout=0.1,
                    max_queue=1,
                    ping_interval=None,
                )
            )
            if protocol is _FOXGLOVE:
                topics = [{"id": channel, "channelId": channel} for channel in range(1, _N_CHANNELS)]
                slow.send(json.dumps({"op": "subscribe", "subscriptions": topics}))
        drawing.start()
        stack.callback(drawing.join)
        stack.callback(over.set)
        yield


def _acknowledge_cycles(host: str, over: threading.Event) -> None:
    """Acknowledge every message of cycles, as a browser does after drawing it."""
    with connect(f"ws://{host}/", subprotocols=[_PAGE], close_timeout=0.1, ping_interval=None) as page:
        while not over.is_set():
            with contextlib.suppress(TimeoutError):
                if isinstance(page.recv(timeout=0.2), bytes):
                    page.send('{"type": "drawn"}')
