"""`footsense run` as a process of its own that tells how far it is, as systemd would see it."""

import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

#: Longest wait for anything [s]; what hangs is then seen to.
TIMEOUT_S = 20

#: Time of the robot between two signs of life [s], five scans: the loop asks at each whether one is due.
SIGN_OF_LIFE_S = 0.12


class Daemon:
    """A running daemon.

    Args:
        process: The process, leader of a group of its own.
        notify: The socket that it reports to.

    Attributes:
        pid: Of the loop's process.
        said: Messages to systemd, as far as they were waited for.
        signs: Signs of life that it has given since it was ready.
    """

    def __init__(self, process: subprocess.Popen[str], notify: socket.socket) -> None:
        self._process = process
        self._notify = notify
        self._end = os.pidfd_open(process.pid)
        self.pid = process.pid
        self.signs = 0
        self.said: list[bytes] = []

    def wait_until_ready(self) -> None:
        """Return with the first forces."""
        while not self._hear().startswith(b"READY=1"):
            pass

    def live_on(self, signs: int) -> None:
        """Return when the loop has run for so many signs of life from now on."""
        self._take_all()
        wanted = self.signs + signs
        while self.signs < wanted:
            self._hear()

    def _hear(self) -> bytes:
        """Wait for what it says next and return it."""
        said, _, _ = select.select([self._notify.fileno(), self._end], [], [], TIMEOUT_S)
        assert said, f"no word for {TIMEOUT_S} s"
        if self._notify.fileno() not in said:
            raise AssertionError(f"it ended: {self._process.communicate()}")
        return self._take(self._notify.recv(4096))

    def _take_all(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                self._take(self._notify.recv(4096))

    def _take(self, message: bytes) -> bytes:
        self.signs += message.startswith(b"WATCHDOG=1")
        self.said.append(message)
        return message

    def child(self, module: str) -> int:
        """Return the process id of the child that runs a module."""
        for entry in Path("/proc").iterdir():
            if entry.name.isdecimal() and module in _command_line(entry) and _parent(entry) == self.pid:
                return int(entry.name)
        raise AssertionError(f"no child runs {module}")

    def kill_all(self) -> None:
        """Kill the process and its children at once, as the end of the power would."""
        os.killpg(self.pid, signal.SIGKILL)
        self._process.wait(TIMEOUT_S)

    def close(self) -> None:
        """Leave nothing of it running."""
        self._process.kill()
        self._process.communicate(timeout=TIMEOUT_S)
        os.close(self._end)

    def stop(self) -> tuple[int, str, str]:
        """Ask it to end; return its exit code, its output, and its errors."""
        self._process.send_signal(signal.SIGTERM)
        output, errors = self._process.communicate(timeout=TIMEOUT_S)
        self._take_all()
        return self._process.returncode, output, errors or ""


def _command_line(entry: Path) -> str:
    try:
        return (entry / "cmdline").read_text()
    except OSError:  # it has ended
        return ""


def _parent(entry: Path) -> int:
    try:
        return int((entry / "stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return 0


@contextlib.contextmanager
def running(folder: Path, *arguments: str | Path, stderr: int = subprocess.PIPE) -> Iterator[Daemon]:
    """Run `footsense run --realtime` until the test ends.

    Args:
        folder: For its notification socket.
        arguments: More of the command line.
        stderr: Where its errors go, as `subprocess.Popen` takes it.

    Yields:
        The daemon, from its start on.
    """
    environment = {"NOTIFY_SOCKET": str(folder / "notify"), "WATCHDOG_USEC": str(round(2e6 * SIGN_OF_LIFE_S))}
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify:
        notify.bind(environment["NOTIFY_SOCKET"])
        notify.setblocking(False)
        process = subprocess.Popen(
            [sys.executable, "-m", "footsense", "run", "--realtime", *map(str, arguments)],
            env={**os.environ, **environment},
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            process_group=0,
        )
        daemon = Daemon(process, notify)
        try:
            yield daemon
        finally:
            daemon.close()
