"""Virtio ports of the machine, as sockets outside: shell commands, commands to the chips, and the frames on CAN."""

import json
import socket
import threading
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

#: Longest wait for an answer of the chips [s].
_ANSWER_S = 300


class GuestError(AssertionError):
    """A command in the machine failed, or did not answer in time."""


class LinePort:
    """A port that lines come from, each handed to a function in a thread of its own."""

    def __init__(self, path: Path, on_line: Callable[[bytes], None]) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(str(path))
        self._on_line = on_line
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def send(self, line: str) -> None:
        """Send one line."""
        self._socket.sendall(line.encode() + b"\n")

    def _read(self) -> None:
        rest = b""
        while data := self._socket.recv(65536):
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                self._on_line(line)

    def close(self) -> None:
        """End the reading."""
        self._socket.shutdown(socket.SHUT_RDWR)
        self._reader.join()
        self._socket.close()


class Shell:
    """Runs commands in the machine.

    Args:
        path: Socket of the port `agent`.

    Attributes:
        ended_s: When the last command that was waited for ended, by the machine's clock [s].
    """

    def __init__(self, path: Path) -> None:
        self.ended_s = 0.0
        self._answers: dict[int, dict[str, Any]] = {}
        self._changed = threading.Condition()
        self._ids = count()
        self.port = LinePort(path, self._take)

    def _take(self, line: bytes) -> None:
        try:
            answer = json.loads(line)
        except ValueError:  # the rest of an answer from before a restart
            return
        with self._changed:
            self._answers[answer["id"]] = answer
            self._changed.notify_all()

    def start(self, command: str, timeout_s: float = 1200) -> int:
        """Start a command, and return the number to wait for it."""
        number = next(self._ids)
        self.port.send(json.dumps({"id": number, "command": command, "timeout_s": timeout_s}))
        return number

    def wait(self, number: int, timeout_s: float = 1200) -> tuple[int, str]:
        """Return exit code and output of a started command.

        Raises:
            GuestError: There is no answer.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: number in self._answers, timeout_s):
                raise GuestError(f"no answer from the machine for {timeout_s} s")
            answer = self._answers.pop(number)
        self.ended_s = float(answer["t_s"])
        return answer["code"], answer["output"]

    def run(self, command: str, timeout_s: float = 1200) -> str:
        """Return the output of a command.

        Raises:
            GuestError: It failed.
        """
        code, output = self.wait(self.start(command, timeout_s), timeout_s + 60)
        if code:
            raise GuestError(f"{command}: exit {code}\n{output[-3000:]}")
        return output

    def wait_until_up(self, timeout_s: float) -> None:
        """Return when the machine answers.

        Raises:
            GuestError: It does not.
        """
        end_s = time.monotonic() + timeout_s
        while True:
            try:
                self.wait(self.start("true"), 5)
            except GuestError:
                if time.monotonic() > end_s:
                    raise
            else:
                return


class Chips:
    """Commands to the simulated chips, see `guest/chip_server.py`.

    Args:
        path: Socket of the port `chips`.

    Attributes:
        ended_s: When the last command was executed, by the machine's clock [s].
    """

    def __init__(self, path: Path) -> None:
        self.ended_s = 0.0
        self._answers: list[str] = []
        self._changed = threading.Condition()
        self.port = LinePort(path, self._take)

    def _take(self, line: bytes) -> None:
        with self._changed:
            self._answers.append(line.decode())
            self._changed.notify_all()

    def do(self, command: str) -> str:
        """Return the answer to a command.

        Raises:
            GuestError: It was refused, or there is no answer.
        """
        with self._changed:
            self._answers.clear()
            self.port.send(command)
            if not self._changed.wait_for(lambda: self._answers, _ANSWER_S):
                raise GuestError(f"chips: no answer to {command!r}")
            answer = self._answers[0]
        if command not in {"count", "time"}:
            done, _, ended = answer.partition(" ")
            if done != "done":
                raise GuestError(f"chips: {command}: {answer}")
            self.ended_s = float(ended)
        return answer

    @property
    def counts(self) -> tuple[int, int]:
        """Transfers and RESET pulses since the start of the chips."""
        transfers, pulses = self.do("count").split()
        return int(transfers), int(pulses)

    @property
    def monotonic_s(self) -> float:
        """Time of the machine, on a clock that nobody steps [s]."""
        return float(self.do("time").split()[0])
