"""Whatever breaks around the process: the forces go on, and what was recorded can be read."""

import fcntl
import os
import re
import resource
import signal
from pathlib import Path

import pytest

from footsense.recording.recorder import partial_path
from tests.support.cycles import read_until_damage
from tests.system.command import footsense, robot, without_lag
from tests.system.daemon import SIGN_OF_LIFE_S, Daemon, running

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


@pytest.mark.parametrize("breaks", ["its disk", "the writer"])
def test_a_recording_that_breaks_off(tmp_path: Path, breaks: str) -> None:
    """The forces go on, one line says so at once and one at the end; what is written can be read."""
    path = tmp_path / "walk.mcap"
    with running(tmp_path, "--config", robot(tmp_path), "--record", path) as daemon:
        wait_until_recording(daemon, path)
        if breaks == "the writer":
            os.kill(daemon.child(WRITER), signal.SIGKILL)
            says = "its writer was killed"
        else:
            full = partial_path(path).stat().st_size + 100
            resource.prlimit(daemon.child(WRITER), resource.RLIMIT_FSIZE, (full, full))
            says = "File too large"
        daemon.live_on(10)
        code, _, errors = daemon.stop()
    at_once, at_the_end = without_lag(errors)
    assert code == 74
    assert at_once == f"ERROR: {path}: {says}; the run goes on without its recording"
    assert re.search(says + r"; [1-9]\d* of \d+ cycles are missing, the others are in", at_the_end)
    replays(partial_path(path), cut=True)


def test_a_log_that_nobody_reads(tmp_path: Path) -> None:
    """With standard error a full pipe, faults come and go and the forces with them; the end is clean."""
    scene = tmp_path / "scene.yaml"
    absent = "{{fault: absent, leg: lf, at_s: {:.1f}, until_s: {:.2f}}}"
    faults = ", ".join(absent.format(at / 10, at / 10 + 0.05) for at in range(2, 30))
    scene.write_text(
        f"description: a leg that comes and goes\nload: {{kind: unloaded}}\nfaults: [{faults}]\n"
    )
    read_end, write_end = os.pipe()
    os.write(write_end, bytes(fcntl.fcntl(write_end, fcntl.F_GETPIPE_SZ)))
    with running(tmp_path, "--config", robot(tmp_path), "--scene", scene, stderr=write_end) as daemon:
        os.close(write_end)
        daemon.wait_until_ready()
        daemon.live_on(15)
        assert daemon.stop()[0] == 0
    os.close(read_end)


def test_files_that_may_change_under_the_running_service(tmp_path: Path) -> None:
    """The network and the table of the simulated feet are read once: nothing of them stays open or mapped."""
    with running(tmp_path, "--config", robot(tmp_path)) as daemon:
        daemon.wait_until_ready()
        assert not [name for name in opened(daemon) if name.endswith((".onnx", ".npz"))]
        assert daemon.stop()[0] == 0


def opened(daemon: Daemon) -> list[str]:
    """Return the names of all files that the daemon has open or mapped."""
    process = Path("/proc") / str(daemon.pid)
    descriptors = [str(fd.readlink()) for fd in (process / "fd").iterdir()]
    return descriptors + [line.rpartition(" ")[2] for line in (process / "maps").read_text().splitlines()]
