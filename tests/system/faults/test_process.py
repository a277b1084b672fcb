"""Whatever breaks around the process: the forces go on, and what was recorded can be read."""

import fcntl
import os
import re
import resource
import shutil
import signal
from pathlib import Path

import can
import pytest

from firmware_interface.can.force import FORCE_ID, QUALITY_ID
from footsense.daemon.foot_types import released_path
from footsense.recording.recorder import partial_path
from tests.support.cycles import read_until_damage
from tests.system.command import footsense, robot, serving
from tests.system.daemon import SIGN_OF_LIFE_S, Daemon, running
from tests.system.test_service import scraped

pytestmark = pytest.mark.slow

WRITER = "footsense.recording.writer"


def recorded_s(path: Path) -> float:
    """Return the time that a recording covers."""
    sent_ns = [cycle.forces.t_sent_ns for cycle in read_until_damage(path)[0]]
    return (sent_ns[-1] - sent_ns[0]) * 1e-9


def replays(path: Path, *options: str | Path, cut: bool = False) -> None:
    """Check that a recording, whole or cut short, gives the same forces again."""
    result = footsense("replay", path, "--check", *options)
    assert (result.returncode, "cut short or damaged" in result.stderr) == ((74, True) if cut else (0, False))
    assert re.match(r"[1-9]\d* cycles equal bit for bit", result.stdout)


def wait_until_recording(daemon: Daemon, path: Path) -> None:
    """Return when the first cycles are in the file: the writer takes its time to start."""
    daemon.wait_until_ready()
    while not read_until_damage(partial_path(path))[0]:
        daemon.live_on(1)


def test_the_end_of_all_power_costs_less_than_a_second(tmp_path: Path) -> None:
    """Loop and writer killed at once: all but the last second is there, and replays."""
    path = tmp_path / "walk.mcap"
    with running(tmp_path, "--config", robot(tmp_path), "--record", path) as daemon:
        wait_until_recording(daemon, path)
        daemon.live_on(10)
        daemon.kill_all()
    assert recorded_s(partial_path(path)) > daemon.signs * SIGN_OF_LIFE_S - 1.0
    replays(partial_path(path), cut=True)


def test_a_disk_that_gets_full(tmp_path: Path) -> None:
    """The forces go on, one line says so at once and one at the end; what is written can be read."""
    path = tmp_path / "walk.mcap"
    with running(tmp_path, "--config", robot(tmp_path), "--record", path) as daemon:
        wait_until_recording(daemon, path)
        full = partial_path(path).stat().st_size + 100
        resource.prlimit(daemon.child(WRITER), resource.RLIMIT_FSIZE, (full, full))
        daemon.live_on(10)
        code, _, errors = daemon.stop()
    at_once, at_the_end = errors.splitlines()
    assert code == 74
    assert at_once == f"ERROR: {path}: File too large; the run goes on without its recording"
    assert re.search(r"File too large; [1-9]\d* of \d+ cycles are missing, the others are in", at_the_end)
    replays(partial_path(path), cut=True)


def test_a_writer_that_is_killed(tmp_path: Path) -> None:
    """As with a full disk: the loop does not end, nor wait, nor repeat itself."""
    path = tmp_path / "walk.mcap"
    with running(tmp_path, "--config", robot(tmp_path), "--record", path) as daemon:
        daemon.wait_until_ready()
        os.kill(daemon.child(WRITER), signal.SIGKILL)
        daemon.live_on(5)
        code, _, errors = daemon.stop()
    at_once, at_the_end = errors.splitlines()
    assert code == 74
    assert at_once == f"ERROR: {path}: its writer was killed; the run goes on without its recording"
    assert "its writer was killed" in at_the_end


def test_an_exporter_that_is_killed(tmp_path: Path) -> None:
    """The forces go on, and the next exporter shows the same service."""
    config = robot(tmp_path, more=f"ring: {tmp_path / 'ring'}\n")
    with running(tmp_path, "--config", config) as daemon:
        daemon.wait_until_ready()
        with serving("exporter", "--config", config, "--port", "0") as (process, _):
            process.kill()
        daemon.live_on(5)
        with serving("exporter", "--config", config, "--port", "0") as (_, url):
            assert "footsense_up 1.0" in scraped(url)
        assert daemon.stop()[0] == 0


FAULTS = """
description: a leg that comes and goes, so that there is something to log
load: {kind: unloaded}
faults:
"""


def test_a_log_that_nobody_reads(tmp_path: Path) -> None:
    """With standard error a full pipe, faults come and go and the forces with them; the end is clean."""
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        FAULTS
        + "".join(
            f"  - {{fault: absent, leg: lf, at_s: {at / 10}, until_s: {at / 10 + 0.05}}}\n"
            for at in range(2, 30)
        )
    )
    read_end, write_end = os.pipe()
    os.write(write_end, bytes(fcntl.fcntl(write_end, fcntl.F_GETPIPE_SZ)))
    with running(tmp_path, "--config", robot(tmp_path), "--scene", scene, stderr=write_end) as daemon:
        os.close(write_end)
        daemon.wait_until_ready()
        daemon.live_on(15)
        assert daemon.stop()[0] == 0
    os.close(read_end)


#: Read by Python before anything else: the wall clock of the process and its children jumps at every look.
STEPPING = """
import itertools, time
jumps = itertools.cycle([86_400, -3_600_000, 7_000_000])
now = [1_700_000_000]
def step(): now[0] += next(jumps); return now[0]
real_gmtime, real_localtime = time.gmtime, time.localtime
time.time = lambda: float(step())
time.time_ns = lambda: step() * 10**9
time.gmtime = lambda seconds=None: real_gmtime(step() if seconds is None else seconds)
time.localtime = lambda seconds=None: real_localtime(step() if seconds is None else seconds)
"""


def test_a_wall_clock_that_is_set(tmp_path: Path) -> None:
    """With a wall clock that jumps by weeks, forces and their times are the same; only the header's date is not."""
    (tmp_path / "sitecustomize.py").write_text(STEPPING)
    path, stepped, still = tmp_path / "walk.mcap", tmp_path / "stepped.log", tmp_path / "still.log"
    options = ("--config", robot(tmp_path), "--duration", "0.7", "--record", path, "--can-log", stepped)
    with running(
        tmp_path, *options, env={"PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"}
    ) as daemon:
        assert daemon.wait() == 0
    replays(path, "--can-log", still)
    stepped_forces, still_forces = (
        [
            (message.timestamp, message.arbitration_id, bytes(message.data))
            for message in can.LogReader(log)
            if FORCE_ID < message.arbitration_id < QUALITY_ID + 0x80
        ]
        for log in (stepped, still)
    )
    assert len(stepped_forces) > 80
    assert stepped_forces == still_forces


def test_files_that_change_under_the_running_service(tmp_path: Path) -> None:
    """The network and the table of the simulated feet are read once: nothing of them stays open or mapped."""
    network = tmp_path / "network.onnx"
    shutil.copy(released_path("network.onnx"), network)
    config, path = robot(tmp_path, more="model: network.onnx\n"), tmp_path / "walk.mcap"
    with running(tmp_path, "--config", config, "--record", path) as daemon:
        daemon.wait_until_ready()
        whole = network.read_bytes()
        with network.open("r+b") as file:
            file.truncate(100)
        daemon.live_on(5)
        held = opened(daemon)
        code, _, errors = daemon.stop()
    assert (code, errors) == (0, "")
    assert not [name for name in held if name.endswith((".onnx", ".npz"))]
    network.write_bytes(whole)
    replays(path)


def opened(daemon: Daemon) -> list[str]:
    """Return the names of all files that the daemon has open or mapped."""
    process = Path("/proc") / str(daemon.pid)
    descriptors = [str(fd.readlink()) for fd in (process / "fd").iterdir()]
    return descriptors + [line.rpartition(" ")[2] for line in (process / "maps").read_text().splitlines()]
