"""Every file that a command reads, with something else in its place: one line at once, and nothing is left behind."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import click
import pytest

from footsense.calibration.writer import write_calibration
from footsense.cli import LazyGroup, main
from footsense.daemon.foot_types import released_path
from footsense.foot.response_table import FootResponse
from footsense.sim.loads.load_log import RepeatedLog
from tests.fuzz.outcome import refusal
from tests.support.calibrations import content
from tests.system.command import robot

GOLDEN = Path(__file__).parents[2] / "golden/measured_walk.mcap"
#: Where FILE stands in a command line, the file is.
FILE = "FILE"

#: Runs commands in children of its own, so that one that blocks or takes a signal harms nothing: each line of standard
#: input names a folder and arguments, each line of standard output an exit code, or the signal that ended it.
SERVER = """
import importlib, json, os, signal, sys
import footsense.cli
for module, _ in footsense.cli.main.modules.values():
    importlib.import_module(f"footsense.cli.{module}")
for line in sys.stdin:
    folder, *arguments = json.loads(line)
    if (child := os.fork()) == 0:
        signal.alarm(15)
        os.chdir(folder)
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, 0)
        os.dup2(null, 1)
        os.dup2(os.open("../errors", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        footsense.cli.main(arguments)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture(scope="module")
def run() -> Iterator[Callable[[Path, str], tuple[int, str]]]:
    """Return a function that runs a command in a folder, and returns its exit code and standard error."""
    with subprocess.Popen(
        [sys.executable, "-c", SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as server:
        stdin, stdout = server.stdin, server.stdout
        assert stdin is not None
        assert stdout is not None

        def run(folder: Path, command: str) -> tuple[int, str]:
            stdin.write(json.dumps([str(folder), *command.split()]) + "\n")
            stdin.flush()
            return int(stdout.readline()), (folder / "../errors").read_text()

        yield run
        stdin.close()


YAML = b"description: x\nload: {kind: tri"
NETWORK = released_path("network.onnx").read_bytes()[:1000]


class Read(NamedTuple):
    """A command that reads a file, and how such a file begins."""

    command: str
    begins: bytes = YAML
    #: The file, if it is not named on the command line.
    name: str = "named.yaml"


RECORDING = GOLDEN.read_bytes()[:500]
READERS = (
    Read("run --config FILE --record a.mcap"),
    Read("run --scene FILE --record a.mcap --can-log a.log"),
    Read("run --record a.mcap", RECORDING, "a.mcap.partial"),
    Read("run --config model.yaml --record a.mcap", NETWORK, "network.onnx"),
    Read("run --config calibrated.yaml --record a.mcap", b"{", "feet/foot-0007/manifest.json"),
    Read("run --config calibrated.yaml --record a.mcap", b"{", "feet/foot-0007/parameters.json"),
    Read("run --config calibrated.yaml --record a.mcap", NETWORK, "feet/foot-0007/network.onnx"),
    Read("probe --config FILE"),
    Read("probe --scene FILE"),
    Read("check-config FILE"),
    Read("monitor --config FILE"),
    Read("tare lf --config FILE"),
    Read("ros2 --config FILE"),
    Read("exporter --config FILE"),
    Read("selfcal --config FILE"),
    Read("selfcal --recording FILE", RECORDING),
    Read("snapshot a.mcap --config FILE"),
    Read("snapshot a.mcap --ring FILE", b"FSRING03"),
    Read("view --config FILE"),
    Read("view FILE", RECORDING),
    Read("replay FILE", RECORDING),
    Read("export FILE --csv a.csv", RECORDING),
    Read("info FILE", RECORDING),
    Read("info FILE", NETWORK),
    Read("info FILE", b"PK\x03\x04"),
    Read("test-stand calibrate FILE --foot foot-0007", RECORDING),
    Read("test-stand evaluate FILE --foot foot-0007", RECORDING),
    Read("test-stand record a.mcap --foot foot-0007 --reference FILE"),
    Read("test-stand record a.mcap --foot foot-0007 --reference stand.yaml --config FILE"),
    Read("test-stand record a.mcap --foot foot-0007 --reference stand.yaml --scene FILE"),
)
OTHERS: dict[str, Callable[[Path, bytes], object]] = {
    "fifo": lambda path, _: os.mkfifo(path),
    "directory": lambda path, _: path.mkdir(),
    "/dev/zero": lambda path, _: path.symlink_to("/dev/zero"),
    "sparse": lambda path, _: os.truncate(os.open(path, os.O_CREAT | os.O_WRONLY), 1 << 42),
    "truncated": lambda path, begins: path.write_bytes(begins),
}


def commands_of(group: LazyGroup) -> Iterator[tuple[str, click.Command]]:
    """Yield each command with what a user types for it, those of groups as well."""
    for name in group.list_commands(click.Context(group)):
        command = group.get_command(click.Context(group), name)
        assert command is not None
        if isinstance(command, LazyGroup):
            yield from ((f"{name} {inner}", found) for inner, found in commands_of(command))
        yield name, command


def test_the_table_has_every_file_argument() -> None:
    """Of the commands that a robot needs; `lab` needs minutes of imports."""
    reads_nothing = {"--record", "--can-log", "--dbc", "--csv", "--ros2", "--map", "--write", "out", "target"}
    follows_a_ring = {("view", "--ring"), ("exporter", "--ring"), ("selfcal", "--ring")}  # until there is one
    commands = dict(commands_of(main))
    named = set()
    for name, command in commands.items():
        for option in command.params:
            if (isinstance(option.type, click.Path) and option.type.file_okay) or option.name == "scene_name":
                named.add((name, option.opts[0]))
    named = {(name, option) for name, option in named if option not in reads_nothing} - follows_a_ring
    tried = {
        (
            next(name for name in commands if read.command.startswith(f"{name} ")),
            before if before.startswith("--") else "argument",
        )
        for read in READERS
        for before, word in zip(read.command.split(), read.command.split()[1:], strict=False)
        if word == FILE
    }
    assert {(name, option if option.startswith("--") else "argument") for name, option in named} == tried


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: f"{reader.command} {reader.name}")
def test_something_else_is_one_line(
    tmp_path: Path, run: Callable[[Path, str], tuple[int, str]], reader: Read
) -> None:
    """Whatever it is, at once, without a traceback, and without a file that was not there before."""
    folder = folder_for(reader, tmp_path / "work")
    path = folder / reader.name
    path.unlink(missing_ok=True)
    for kind, make in OTHERS.items():
        make(path, reader.begins)
        before = sorted(folder.rglob("*"))
        code, errors = run(folder, reader.command.replace(FILE, reader.name))
        assert code > 0, (kind, code, errors)
        assert errors.startswith("footsense: "), (kind, errors)
        assert errors.count("\n") == 1, (kind, errors)
        assert path.name in errors, (kind, errors)
        assert sorted(folder.rglob("*")) == before, kind
        path.rmdir() if kind == "directory" else path.unlink()


def folder_for(reader: Read, folder: Path) -> Path:
    """Make a folder with the other files that a command needs, and return it."""
    folder.mkdir()
    robot(folder, more="model: network.onnx\n").rename(folder / "model.yaml")
    if "calibrated.yaml" in reader.command:
        write_calibration(folder / "feet", **content())
        robot(folder, more="feet: {lf: foot-0007}\ncalibrations: feet\n").rename(folder / "calibrated.yaml")
    stand = Path(__file__).parents[3] / "deploy/test-stand-simulated.yaml"
    (folder / "stand.yaml").write_text(stand.read_text())
    return folder


@pytest.mark.parametrize("kind", OTHERS)
def test_a_response_table_and_a_log_of_loads_are_one_line(tmp_path: Path, kind: str) -> None:
    """What a simulation reads that no argument names: the table of its feet, and the file of a scene."""
    path = tmp_path / "named.npz"
    OTHERS[kind](path, b"PK")
    assert refusal(lambda: FootResponse.load(path))
    assert refusal(lambda: RepeatedLog(path, 0))
