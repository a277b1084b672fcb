"""What shows the service's counters to Prometheus: the only file that knows prometheus_client.

It runs in a process of its own, which `exporter_keeper` starts, and starts again if it should die.
"""

import errno
import sys
from collections.abc import Callable, Iterable, Sequence
from itertools import product
from pathlib import Path

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

from footsense.errors import FootsenseError
from footsense.telemetry.shared_counters import Family, read_counters

__all__ = ["SharedCollector", "serve"]


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


def _remedy(error: OSError | OverflowError) -> str:
    """Return what would be right instead: another port, or an address of this machine."""
    if isinstance(error, OverflowError) or error.errno in {errno.EADDRINUSE, errno.EACCES}:
        return "choose another metrics.port"
    return "metrics.address has to be an address of this machine, such as 127.0.0.1"


def serve(file: Path, address: str, port: int, say: Callable[[str], None]) -> int:
    """Show one file of counters until standard input ends.

    Args:
        file: What `SharedCounters` made; removed at the end, for a service that was killed could not do it itself.
        address: IP address to listen on.
        port: TCP port; 0 for any that is free.
        say: Gets one word and what follows from it: `ready PORT`, `refused REASON` or `failed REASON`.

    Returns:
        The exit code of the process.
    """
    try:
        families, cells = read_counters(file)
    except FootsenseError as error:
        say(f"failed {error}")
        return error.exit_code
    registry = CollectorRegistry()
    registry.register(SharedCollector(families, cells))
    try:
        server, _ = start_http_server(port, address, registry)
    except (OSError, OverflowError) as error:
        say(f"refused {getattr(error, 'strerror', None) or error}; {_remedy(error)}")
        return 2
    say(f"ready {server.server_port}")
    sys.stdin.buffer.read()
    file.unlink(missing_ok=True)
    return 0
