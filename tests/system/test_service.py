"""The daemon as systemd sees it: ready, alive, and cleanly gone; its metrics as Prometheus sees them."""

import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import can
import pytest

from firmware_interface.can.codes import NODE_IDS
from footsense.recording.recorder import partial_path
from footsense.recording.replay import Replay
from tests.system.command import TIMEOUT_S, footsense, one_line_error, robot, serving, without_lag
from tests.system.daemon import running


def scraped(url: str) -> list[str]:
    """Return the lines of the page, as Prometheus reads it."""
    with urlopen(url, timeout=TIMEOUT_S) as page:
        text: str = page.read().decode()
    return text.splitlines()


@pytest.fixture
def config(tmp_path: Path) -> tuple[Path, int]:
    """A simulated robot of two legs with metrics on a free port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return robot(tmp_path, more=f"metrics: {{port: {port}}}\n"), port


@pytest.mark.slow
def test_it_gets_ready_shows_metrics_and_stops_cleanly(tmp_path: Path, config: tuple[Path, int]) -> None:
    """READY after the first forces; SIGTERM gives STOPPING, a last heartbeat `stopped`, a whole recording, exit 0."""
    file, port = config
    options = ("--can-log", tmp_path / "can.log", "--record", tmp_path / "walk.mcap")
    with serving("exporter", "--config", file) as (exporter, url):
        assert url == f"http://127.0.0.1:{port}/metrics"
        assert "footsense_up 0.0" in scraped(url)
        with running(tmp_path, "--config", file, *options) as daemon:
            daemon.wait_until_ready()
            daemon.live_on(1)
            text = "\n".join(scraped(url))
            code, _, errors = daemon.stop()
        assert daemon.said[0].startswith(b"READY=1\nSTATUS=lf starting")
        assert daemon.said[-1] == b"STOPPING=1"
        assert "footsense_up 0.0" in scraped(url)
        exporter.send_signal(signal.SIGTERM)
        assert exporter.wait(TIMEOUT_S) == 0
    assert (code, without_lag(errors)) == (0, [])
    for name in (
        "footsense_up 1.0",
        *("footsense_cycle_period_seconds_bucket", "footsense_frame_age_seconds_bucket"),
        *("footsense_faults_total", "footsense_can_sent_frames_total", "footsense_can_dropped_frames_total"),
    ):
        assert name in text
    # Of each leg the last one; the bit of late cycles depends on the computer.
    heartbeats = {
        message.arbitration_id: message.data[0] & 0x7F
        for message in can.LogReader(tmp_path / "can.log")
        if message.arbitration_id - 0x148 in NODE_IDS.values()
    }
    assert heartbeats == {0x149: 4, 0x14C: 4}
    result = footsense("replay", tmp_path / "walk.mcap", "--check")
    assert (result.returncode, result.stderr) == (0, "")


def test_sigterm_during_the_start_ends_it(tmp_path: Path) -> None:
    """Well, at once, and without a recording of nothing."""
    path = tmp_path / "walk.mcap"
    with running(tmp_path, "--config", robot(tmp_path), "--record", path) as daemon:
        while not partial_path(path).exists() and not path.exists():
            os.sched_yield()
        code, _, errors = daemon.stop()
    assert (code, without_lag(errors)) == (0, [])
    assert not partial_path(path).exists()
    assert not path.exists() or any(Replay(path))  # the test was slower than the start


@pytest.mark.slow
def test_what_watches_the_service_is_not_in_its_process(config: tuple[Path, int]) -> None:
    """Metrics, odometers, page, snapshot and Foxglove have processes of their own; the loop's loads none of them."""
    command = [sys.executable, "-X", "importtime", "-m", "footsense", "run", "--config", str(config[0])]
    done = subprocess.run(
        [*command, "--fast", "--duration", "0.1"],
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=True,
    )
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "footsense.daemon.loop" in imported
    beside = ("metrics", "exporter", "feet", "electrodes")
    watching = {f"footsense.telemetry.{name}" for name in beside} | {"footsense.recording.fault_recordings"}
    assert not imported & {*watching, "footsense.view", "prometheus_client", "websockets", "foxglove"}


def test_a_metrics_port_in_use_costs_metrics_and_no_forces(config: tuple[Path, int]) -> None:
    """The exporter names the key to change, of port or address (192.0.2.1 is nobody's); the service needs none."""
    file, port = config
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", port))
        taken.listen()
        line = one_line_error(footsense("exporter", "--config", file), 78)
        result = footsense("run", "--config", file, "--duration", "1")
    assert line == (
        f"metrics cannot be served on 127.0.0.1:{port}: Address already in use; choose another port: --port, or "
        "metrics.port"
    )
    assert (result.returncode, result.stderr) == (0, "")
    file.write_text(file.read_text().replace("metrics: {", "metrics: {address: 192.0.2.1, "))
    line = one_line_error(footsense("exporter", "--config", file), 78)
    assert re.search(rf"192\.0\.2\.1:{port}: Cannot assign .*; metrics\.address has to be", line)


def test_a_run_of_a_configuration_says_how_to_see_it(tmp_path: Path) -> None:
    """While it lasts: a simulation that is over in a moment has nothing to show."""
    config = robot(tmp_path)
    line = f"page: run footsense view --config {config}"
    assert (
        line in footsense("run", "--config", config, "--duration", "1", "--realtime").stdout.splitlines()[:2]
    )
    assert "page:" not in footsense("run", "--config", config, "--duration", "1").stdout


def test_a_ring_that_cannot_be_written_costs_no_forces_and_no_recording(tmp_path: Path) -> None:
    """One warning names the file, and no line a page; the recorder reads one without a name."""
    config = robot(tmp_path, more=f"ring: {tmp_path / 'none' / 'ring'}\n")
    result = footsense(
        "run", "--config", config, "--duration", "1", "--realtime", "--record", tmp_path / "walk.mcap"
    )
    assert (result.returncode, "page:" in result.stdout) == (0, False)
    (warning,) = without_lag(result.stderr)
    assert warning == (
        f"WARNING: {tmp_path}/none/ring: cannot be written: No such file or directory; "
        "the forces go on without metrics, page and snapshot"
    )
    assert footsense("replay", tmp_path / "walk.mcap", "--check").returncode == 0


def test_a_snapshot_of_a_running_service(tmp_path: Path) -> None:
    """It is a recording that opens anywhere and is replayed, but not compared; without a service it is one line."""
    target, config = tmp_path / "last.mcap", robot(tmp_path)
    arguments = ("snapshot", target, "--config", config)
    assert "ring: no service runs" in one_line_error(footsense(*arguments), 1)
    with running(tmp_path, "--config", config) as daemon:
        daemon.wait_until_ready()
        result = footsense(*arguments)
    assert result.returncode == 0, result.stderr
    assert re.fullmatch(rf"{target}: \d+ cycles\n", result.stdout)
    assert "exists and is not overwritten" in one_line_error(footsense(*arguments), 74)
    assert footsense("replay", target).stdout.endswith("cycles replayed\n")
    assert "is a snapshot, which begins in the middle" in one_line_error(
        footsense("replay", target, "--check"), 74
    )
