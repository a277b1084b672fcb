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

from tests.system.command import TIMEOUT_S, footsense, one_line_error, robot, serving


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
    file = tmp_path / "robot.yaml"
    file.write_text(
        "buses: [{device: sim, legs: {lf: 0, rf: 1}}]\ncan: {interface: virtual}\n"
        f"metrics: {{port: {port}}}\nring: {tmp_path / 'ring'}\n"
    )
    return file, port


@pytest.mark.slow
def test_it_gets_ready_shows_metrics_and_stops_cleanly(tmp_path: Path, config: tuple[Path, int]) -> None:
    """READY after the first forces; SIGTERM gives STOPPING, a last heartbeat `stopped`, a whole recording, exit 0."""
    file, port = config
    with (
        serving("exporter", "--config", file) as (exporter, url),
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify,
    ):
        assert url == f"http://127.0.0.1:{port}/metrics"
        assert "footsense_up 0.0" in scraped(url)
        notify.bind(str(tmp_path / "notify"))
        notify.settimeout(TIMEOUT_S)
        daemon = subprocess.Popen(
            [
                *(sys.executable, "-m", "footsense", "run", "--realtime", "--config", str(file)),
                *("--can-log", str(tmp_path / "can.log"), "--record", str(tmp_path / "walk.mcap")),
            ],
            env={**os.environ, "NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "200000"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            assert notify.recv(4096).startswith(b"READY=1\nSTATUS=lf starting")
            assert notify.recv(4096) == b"WATCHDOG=1"
            text = "\n".join(scraped(url))
            daemon.send_signal(signal.SIGTERM)
            messages = [notify.recv(4096)]
            while messages[-1] != b"STOPPING=1":
                messages.append(notify.recv(4096))
            _, errors = daemon.communicate(timeout=TIMEOUT_S)
        finally:
            daemon.kill()
            daemon.wait()
        assert "footsense_up 0.0" in scraped(url)
        exporter.send_signal(signal.SIGTERM)
        assert exporter.wait(TIMEOUT_S) == 0
    assert (daemon.returncode, errors) == (0, "")
    for name in (
        "footsense_up 1.0",
        *("footsense_cycle_period_seconds_bucket", "footsense_frame_age_seconds_bucket"),
        *("footsense_faults_total", "footsense_can_sent_frames_total", "footsense_can_dropped_frames_total"),
    ):
        assert name in text
    heartbeats = {
        message.arbitration_id: bytes(message.data)
        for message in can.LogReader(tmp_path / "can.log")
        if message.arbitration_id > 0x700
    }
    assert heartbeats == {0x701: b"\x04", 0x704: b"\x04"}
    result = footsense("replay", tmp_path / "walk.mcap", "--check")
    assert (result.returncode, result.stderr) == (0, "")


def test_a_metrics_port_in_use_costs_metrics_and_no_forces(config: tuple[Path, int]) -> None:
    """The exporter names the port and the key to change; the service needs no port."""
    file, port = config
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", port))
        taken.listen()
        line = one_line_error(footsense("exporter", "--config", file), 78)
        result = footsense("run", "--config", file, "--duration", "1")
    assert line == (
        f"metrics cannot be served on 127.0.0.1:{port}: Address already in use; choose another metrics.port"
    )
    assert (result.returncode, result.stderr) == (0, "")


def test_an_address_of_another_machine_is_not_blamed_on_the_port(config: tuple[Path, int]) -> None:
    """The remedy names the key that is wrong; 192.0.2.0/24 is nobody's, by RFC 5737."""
    file, port = config
    file.write_text(file.read_text().replace("metrics: {", "metrics: {address: 192.0.2.1, "))
    line = one_line_error(footsense("exporter", "--config", file), 78)
    assert re.search(rf"192\.0\.2\.1:{port}: Cannot assign .*; metrics\.address has to be", line)


def test_a_ring_that_cannot_be_written_costs_no_forces_and_no_recording(tmp_path: Path) -> None:
    """One warning names the file; the recorder reads one without a name."""
    config = robot(tmp_path, more=f"ring: {tmp_path / 'none' / 'ring'}\n")
    result = footsense("run", "--config", config, "--duration", "1", "--record", tmp_path / "walk.mcap")
    assert result.returncode == 0
    assert result.stderr == (
        f"WARNING: {tmp_path}/none/ring: cannot be written: No such file or directory; "
        "the forces go on without metrics, page and snapshot\n"
    )
    assert footsense("replay", tmp_path / "walk.mcap", "--check").returncode == 0


def test_a_snapshot_of_a_running_service(tmp_path: Path) -> None:
    """It is a recording that opens anywhere and is replayed, but not compared; without a service it is one line."""
    file = tmp_path / "robot.yaml"
    file.write_text(
        "buses: [{device: sim, legs: {lf: 0, rf: 1}}]\ncan: {interface: virtual}\n"
        f"ring: {tmp_path / 'ring'}\n"
    )
    target = tmp_path / "last.mcap"
    arguments = ("snapshot", target, "--config", file)
    assert "ring: no service runs" in one_line_error(footsense(*arguments), 1)
    command = (sys.executable, "-m", "footsense", "run", "--realtime", "--config", str(file))
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as daemon:
        try:
            while (result := footsense(*arguments)).returncode:
                assert daemon.poll() is None
        finally:
            daemon.terminate()
    assert re.fullmatch(rf"{target}: \d+ cycles\n", result.stdout)
    assert "exists and is not overwritten" in one_line_error(footsense(*arguments), 74)
    assert footsense("replay", target).stdout.endswith("cycles replayed\n")
    assert "is a snapshot, which begins in the middle" in one_line_error(
        footsense("replay", target, "--check"), 74
    )
