"""The start and the end of the processes that show the metrics, as the service sees them.

They live as long as their standard input, a pipe whose other end only this process holds: however this process ends,
the kernel closes it. An exporter that dies is not the service's to notice: its keeper does.
"""

import selectors
import subprocess
import sys
from pathlib import Path

from footsense.errors import ConfigError, FootsenseError

__all__ = ["ExporterProcess", "start_exporter"]


class ExporterProcess:
    """A running exporter and its keeper.

    Attributes:
        port: The TCP port that it listens on.
    """

    def __init__(self, process: subprocess.Popen[bytes], port: int) -> None:
        self._process = process
        self.port = port

    def close(self) -> None:
        """End it."""
        _end(self._process)


def start_exporter(path: Path, address: str, port: int, timeout_s: float = 20.0) -> ExporterProcess:
    """Start the exporter and wait until it listens.

    It gives up again what it inherits of a process with real-time scheduling.

    Args:
        path: File of the counters: `Metrics.path`.
        address: IP address to listen on.
        port: TCP port; 0 for any that is free.
        timeout_s: How long it may take to start [s].

    Returns:
        The running exporter, which ends by itself when this process does, however that ends.

    Raises:
        ConfigError: The address cannot be listened on, because it is in use or not ours.
        FootsenseError: The exporter did not start.
    """
    options = ("--file", str(path), "--address", address, "--port", str(port))
    process = subprocess.Popen(  # noqa: S603 - our own interpreter and module
        [sys.executable, "-P", "-m", "footsense.telemetry.exporter_keeper", *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        process_group=0,  # Ctrl-C in the terminal is for us; the exporter ends when its standard input does
    )
    assert process.stdout is not None
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        spoke = bool(selector.select(timeout_s))
    line = process.stdout.readline().decode().strip() if spoke else ""
    word, _, rest = line.partition(" ")
    if word == "ready":
        process.stdout.close()
        return ExporterProcess(process, int(rest.split()[0]))
    _end(process)
    if word == "refused":
        raise ConfigError(f"metrics cannot be shown on {address}:{port}: {rest}")
    silence = "it ended without a word" if spoke else f"no word within {timeout_s:g} s"
    raise FootsenseError(f"the metrics exporter did not start: {rest or silence}")


def _end(process: subprocess.Popen[bytes]) -> None:
    """Close the exporter's standard input, at which it ends; if it does not, kill it."""
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
    try:
        process.wait(timeout=5.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
