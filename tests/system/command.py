"""The command line as its user runs it: a process of its own."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

TIMEOUT_S = 120


def footsense(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run `footsense` with these arguments to its end."""
    return subprocess.run(
        [sys.executable, "-m", "footsense", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
        cwd=cwd,
    )


@contextmanager
def serving(*arguments: str | Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run `footsense` with these arguments; yield the process and the address of its page, its first line."""
    with subprocess.Popen(
        [sys.executable, "-m", "footsense", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.terminate()
            process.communicate(timeout=TIMEOUT_S)


def run_json(*arguments: str | Path) -> dict[str, Any]:
    """Run `footsense run ... --summary json` and return the figures."""
    result = footsense("run", *arguments, "--summary", "json")
    assert result.returncode == 0, result.stderr
    figures: dict[str, Any] = json.loads(result.stdout)
    return figures


def one_line_error(result: subprocess.CompletedProcess[str], exit_code: int) -> str:
    """Check that a command failed with one clear line and this exit code, and return the line."""
    assert result.returncode == exit_code, (result.returncode, result.stderr)
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("footsense: ")
    return lines[0].removeprefix("footsense: ")


ROBOT = """
buses:
  - {device: DEVICE, legs: {lf: 0, rf: 1}}
can: {interface: INTERFACE, channel: CHANNEL}
"""


def robot(
    folder: Path, *, device: str = "sim", interface: str = "virtual", channel: str = "can0", more: str = ""
) -> Path:
    """Write a configuration file."""
    file = folder / "robot.yaml"
    text = ROBOT.replace("DEVICE", device).replace("INTERFACE", interface).replace("CHANNEL", channel)
    own_ring = "" if "ring:" in more else f"ring: {folder / 'ring'}\n"  # tests run beside each other
    file.write_text(text + own_ring + more)
    return file


def without_lag(errors: str) -> list[str]:
    """Return the lines of a log without that of a slow computer, whose simulation lags behind real time."""
    return [line for line in errors.splitlines() if "cannot keep pace" not in line]
