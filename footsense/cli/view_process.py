"""Web page of a run: starts and ends `footsense view` as a child process beside the main loop."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from footsense.config.sections import View


@contextlib.contextmanager
def serve_page(view: View, ring: Path) -> Iterator["ViewProcess"]:
    """Serve the web page of a run during a `with` block, on the configured port or on a free one.

    The child process starts before the loop asks for real-time scheduling, and ends with the run.

    Yields:
        The page.
    """
    page = ViewProcess(view, ring)
    try:
        yield page
    finally:
        page.close()


class ViewProcess:
    """Child process that runs `footsense view`.

    Args:
        view: Its section of the configuration.
        ring: The ring of the run.
    """

    def __init__(self, view: View, ring: Path) -> None:
        self._view = view
        self._ring = ring
        self._process = self._start_process(view.port)
        self._url: str | None = None

    def _start_process(self, port: int) -> subprocess.Popen[str]:
        """Start `footsense view` on a port."""
        ring, address = str(self._ring), self._view.address
        arguments = ["--ring", ring, "--address", address, "--port", str(port), "--with-parent"]
        return subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-P", "-m", "footsense", "view", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    @property
    def url(self) -> str:
        """URL of the page; waits until it is served. Empty if it cannot be served."""
        if self._url is None:
            self._url = self._read_url()
            if not self._url:
                self._process.wait()
                self._process = self._start_process(0)
                self._url = self._read_url()
        return self._url

    def _read_url(self) -> str:
        """Return the URL that the child process prints; empty if it ends first."""
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def close(self) -> None:
        """End the child process."""
        self._process.terminate()
        self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
