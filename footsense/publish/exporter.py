"""The process that shows the service's counters to Prometheus: the only file that knows prometheus_client.

    python -m footsense.publish.exporter --file FILE --address 127.0.0.1 --port 9108

It answers on standard output, once, with `ready PORT`, `refused REASON` or `failed REASON`, and ends when its
standard input does: that happens when the service ends, even if it was killed.
"""

import argparse
import contextlib
import errno
import os
import sys
from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

from footsense.errors import FootsenseError
from footsense.publish.shared_counters import Family, read_counters

__all__ = ["SharedCollector", "main"]


class SharedCollector(Collector):
    """Makes Prometheus metrics of shared counters, at each scrape.

    Args:
        families: What is counted.
        cells: The living numbers, family after family.
    """

    def __init__(self, families: list[Family], cells: "memoryview[float]") -> None:
        self._families = families
        self._cells = cells

    def collect(self) -> Iterable[Metric]:
        """Read every metric.

        Yields:
            One metric after the other, with its present values.
        """
        first = 0
        for family in self._families:
            yield _metric(family, self._cells[first : first + family.n_cells].tolist())
            first += family.n_cells


def _metric(family: Family, cells: Sequence[float]) -> Metric:
    """Return one metric of its cells."""
    names = list(family.labels)
    combinations = product(*family.labels.values())
    if family.kind == "histogram":
        histogram = HistogramMetricFamily(family.name, family.help, labels=names)
        bounds = [*(f"{bound:g}" for bound in family.bounds), "+Inf"]
        for number, labels in enumerate(combinations):
            *counts, total = cells[number * family.width : (number + 1) * family.width]
            below = 0.0
            buckets = []
            for bound, count in zip(bounds, counts, strict=True):
                below += count
                buckets.append((bound, below))
            histogram.add_metric(labels, buckets, total)
        return histogram
    kind = CounterMetricFamily if family.kind == "counter" else GaugeMetricFamily
    metric = kind(family.name, family.help, labels=names)
    for labels, value in zip(combinations, cells, strict=True):
        metric.add_metric(labels, value)
    return metric


def _yield_to_the_loop() -> None:
    """Give up what a service with real-time scheduling hands down to its children."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
        os.nice(5)


def _remedy(error: OSError | OverflowError) -> str:
    """Return what would be right instead: another port, or an address of this machine."""
    if isinstance(error, OverflowError) or error.errno in {errno.EADDRINUSE, errno.EACCES}:
        return "choose another metrics.port"
    return "metrics.address has to be an address of this machine, such as 127.0.0.1"


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> int:
    """Show one file of counters until standard input ends; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m footsense.publish.exporter")
    parser.add_argument("--file", type=Path, required=True)
    parser.add_argument("--address", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9108)
    arguments = parser.parse_args()
    _yield_to_the_loop()
    try:
        families, cells = read_counters(arguments.file)
    except FootsenseError as error:
        _say(f"failed {error}")
        return error.exit_code
    registry = CollectorRegistry()
    registry.register(SharedCollector(families, cells))
    try:
        server, _ = start_http_server(arguments.port, arguments.address, registry)
    except (OSError, OverflowError) as error:
        _say(f"refused {getattr(error, 'strerror', None) or error}; {_remedy(error)}")
        return 2
    _say(f"ready {server.server_port}")
    sys.stdin.buffer.read()
    # A service that was killed could not do this itself.
    arguments.file.unlink(missing_ok=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
