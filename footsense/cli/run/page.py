"""The page of a run: `footsense view` as a child process beside the loop."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator

from footsense.config.sections import View


@contextlib.contextmanager
def page_of(view: View) -> Iterator["Page"]:
    """Serve the page of a run on the configured port, or on a free one where that is in use.

    The child process starts before the loop asks for real-time scheduling, and ends with the run.

    Yields:
        The page.
    """
    page = Page(view)
    try:
        yield page
    finally:
        page.close()


class Page:
    """A running `footsense view`.

    Args:
        view: Its section of the configuration.
    """

    def __init__(self, view: View) -> None:
        self._view = view
        self._process = self._start(view.port)
        self._url: str | None = None

    def _start(self, port: int) -> subprocess.Popen[str]:
        view = self._view
        arguments = ["--cycles", view.cycles, "--address", view.address, "--port", str(port)]
        return subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-P", "-m", "footsense", "view", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    @property
    def url(self) -> str:
        """Address of the page; waits until it is served. Empty if it cannot be."""
        if self._url is None:
            self._url = self._read()
            if not self._url:
                self._process.wait()
                self._process = self._start(0)
                self._url = self._read()
        return self._url

    def _read(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def close(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
