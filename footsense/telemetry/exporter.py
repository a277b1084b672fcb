"""Prometheus exporter: reads the cycles of the running service from its ring, and serves what it counts over HTTP.

It runs in `footsense exporter`, a process with a systemd unit of its own. A restarted service is picked up, and one
that has ended or not started yet shows as `footsense_up 0`.
"""

import logging
import threading
from collections.abc import Iterable
from pathlib import Path

from prometheus_client import CollectorRegistry, disable_created_metrics, start_http_server
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from footsense.errors import FootsenseError, serving_errors
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.records import LostCycles
from footsense.telemetry.electrodes import STATE_FOLDER, electrode_metrics, seen_electrodes
from footsense.telemetry.feet import ODOMETER_FILE, Odometer, identity_metrics
from footsense.telemetry.metrics import ServiceMetrics

_log = logging.getLogger(__name__)


class ServiceCollector(Collector):
    """Prometheus collector that counts the cycles of the running service.

    Args:
        path: The service's ring, which need not exist yet; None for where it is by default.
        states: Folder of the states of `footsense selfcal`, which need not exist.
        odometer: File of the feet's odometers, which need not exist.
    """

    def __init__(
        self, path: Path | None, states: Path = STATE_FOLDER, odometer: Path = ODOMETER_FILE
    ) -> None:
        self._path, self._states, self._odometer = path, states, Odometer(odometer)
        self._lock = threading.Lock()
        self._reader: CycleReader | None = None
        self._metrics = ServiceMetrics(())
        self._is_first_look = True
        self._logged = ""

    def poll(self) -> None:
        """Count the cycles since the last call; look for a service if there is none."""
        with self._lock:
            reason = ""
            try:
                if self._reader is None:
                    self._reader = self._open_reader()
                self._count(self._reader)
                if not self._reader.is_still_written():
                    self._close()
                    reason = "it has ended"
            except FootsenseError as error:
                self._close()
                reason = str(error)
            self._is_first_look = False
            if reason != self._logged:
                _log.warning("%s", f"no service: {reason}" if reason else "the service runs")
                self._logged = reason

    def _open_reader(self) -> CycleReader:
        reader = CycleReader(self._path)
        if not self._is_first_look:  # a service that has started since then
            reader.rewind(first_number=0)
        if reader.legs != self._metrics.legs:
            self._metrics = ServiceMetrics(reader.legs)
        self._metrics.begin_service()
        self._odometer.begin(reader.header, reader.legs)
        return reader

    def _count(self, reader: CycleReader) -> None:
        while entries := reader.read():
            for entry in entries:
                if isinstance(entry, LostCycles):
                    self._metrics.add_missed(entry.n_cycles)
                else:
                    self._metrics.add(entry.cycle)
                    self._odometer.add(entry.cycle)
        self._odometer.save(now=False)
        self._metrics.status = reader.status

    def close(self) -> None:
        """End: keep the odometers."""
        with self._lock:
            self._close()

    def _close(self) -> None:
        if self._reader is not None:
            self._odometer.save()
            self._reader.close()
            self._reader = None

    def collect(self) -> Iterable[Metric]:
        """Return `footsense_up`, and while the service runs, all its metrics."""
        self.poll()
        with self._lock:
            up = GaugeMetricFamily(
                "footsense_up", "1 while the service runs.", float(self._reader is not None)
            )
            metrics: list[Metric] = [up]
            if self._reader is not None:
                metrics += identity_metrics(self._reader.header, self._reader.legs)
                metrics += self._metrics.collect()
                metrics += self._odometer.collect()
            return [*metrics, *electrode_metrics(seen_electrodes(self._states))]


def start_metrics_server(path: Path | None, address: str, port: int) -> tuple[ServiceCollector, int]:
    """Serve the metrics over HTTP from a daemon thread until the process ends; return their collector and the port.

    Args:
        path: The service's ring; None for where it is by default.
        address: IP address to listen on.
        port: TCP port; 0 for any free one.

    Returns:
        The collector, to be polled more often than the ring is overwritten, and the TCP port.

    Raises:
        ConfigError: The port is in use or needs privileges, or the address is not of this machine.
    """
    disable_created_metrics()  # type: ignore[no-untyped-call]
    registry = CollectorRegistry()
    collector = ServiceCollector(path)
    registry.register(collector)
    with serving_errors("metrics", "metrics", address, port):
        server, _ = start_http_server(port, address, registry)
    return collector, int(server.server_port)
