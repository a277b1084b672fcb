"""Prometheus exporter of the service's counters over HTTP; no other module imports prometheus_client.

It runs in `footsense exporter`, a process with a systemd unit of its own. Each scrape opens the counters' file anew,
so a restarted service is picked up, and one that has ended or not started yet shows as `footsense_up 0`.
"""

import errno
import logging
from collections.abc import Iterable, Sequence
from itertools import accumulate, islice, product
from pathlib import Path

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

from footsense.errors import ConfigError, FootsenseError
from footsense.telemetry.shared_counters import MetricFamily, read_counters

_log = logging.getLogger(__name__)


class CountersCollector(Collector):
    """Prometheus collector that reads a service's counters at each scrape.

    Args:
        path: File of the counters, as `metrics.counters` in the configuration.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._logged = ""

    def collect(self) -> Iterable[Metric]:
        """Yield the shared counters as Prometheus metrics.

        Yields:
            `footsense_up`, and while the service runs, all its metrics.
        """
        families: list[MetricFamily] = []
        cells: list[float] = []
        reason = ""
        try:
            families, cells = read_counters(self._path)
        except FootsenseError as error:
            reason = str(error)
        if reason != self._logged:
            _log.warning("%s", f"no service: {reason}" if reason else f"{self._path}: the service runs")
            self._logged = reason
        yield GaugeMetricFamily("footsense_up", "1 while the service runs.", value=float(not reason))
        rest = iter(cells)
        for family in families:
            yield _metric(family, list(islice(rest, family.n_cells)))


def _metric(family: MetricFamily, cells: Sequence[float]) -> Metric:
    """Return a metric family's values as one Prometheus metric."""
    names = list(family.label_values)
    combinations = product(*family.label_values.values())
    if family.metric_type == "histogram":
        histogram = HistogramMetricFamily(family.name, family.help, labels=names)
        bounds = [*(f"{bound:g}" for bound in family.bucket_bounds), "+Inf"]
        rest = iter(cells)
        for labels in combinations:
            *counts, total = islice(rest, family.cells_per_label_set)
            histogram.add_metric(labels, list(zip(bounds, accumulate(counts), strict=True)), total)
        return histogram
    kind = CounterMetricFamily if family.metric_type == "counter" else GaugeMetricFamily
    metric = kind(family.name, family.help, labels=names)
    for labels, value in zip(combinations, cells, strict=True):
        metric.add_metric(labels, value)
    return metric


def start_metrics_server(path: Path, address: str, port: int) -> int:
    """Serve the counters over HTTP from a daemon thread until the process ends; return the port.

    Args:
        path: File of the counters; need not exist yet.
        address: IP address to listen on.
        port: TCP port; 0 for any free one.

    Returns:
        The TCP port.

    Raises:
        ConfigError: The port is in use or needs privileges, or the address is not of this machine.
    """
    registry = CollectorRegistry()
    registry.register(CountersCollector(path))
    try:
        server, _ = start_http_server(port, address, registry)
    except OSError as error:
        remedy = "metrics.address has to be an address of this machine, such as 127.0.0.1"
        if error.errno in {errno.EADDRINUSE, errno.EACCES}:
            remedy = "choose another metrics.port"
        raise ConfigError(
            f"metrics cannot be served on {address}:{port}: {error.strerror}; {remedy}"
        ) from error
    return int(server.server_port)
