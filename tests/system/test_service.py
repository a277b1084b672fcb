"""The daemon as systemd sees it: ready, alive, and cleanly gone; its metrics as Prometheus sees them."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import can
import pytest

from tests.system.command import TIMEOUT_S, footsense, one_line_error, robot


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@pytest.fixture
def config(tmp_path: Path) -> tuple[Path, int]:
    """A simulated robot of two legs with metrics on a free port."""
    port = free_port()
    file = tmp_path / "robot.yaml"
    file.write_text(
        "buses: [{device: sim, legs: {lf: 0, rf: 1}}]\ncan: {interface: virtual}\n"
        f"metrics: {{port: {port}}}\n"
    )
    return file, port


def test_it_gets_ready_shows_metrics_and_stops_cleanly(tmp_path: Path, config: tuple[Path, int]) -> None:
    """READY after the first forces; SIGTERM gives STOPPING, a last heartbeat `stopped`, a whole recording, exit 0."""
    file, port = config
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify:
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
            with urlopen(f"http://127.0.0.1:{port}/metrics", timeout=TIMEOUT_S) as page:
                text = page.read().decode()
            daemon.send_signal(signal.SIGTERM)
            messages = [notify.recv(4096)]
            while messages[-1] != b"STOPPING=1":
                messages.append(notify.recv(4096))
            _, errors = daemon.communicate(timeout=TIMEOUT_S)
        finally:
            daemon.kill()
            daemon.wait()
    assert (daemon.returncode, errors) == (0, "")
    for name in (
        *("footsense_scan_period_seconds_bucket", "footsense_frame_age_seconds_bucket"),
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


def test_a_metrics_port_in_use_is_one_clear_line(config: tuple[Path, int], tmp_path: Path) -> None:
    """It names the port and the key to change, and nothing is left behind."""
    file, port = config
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", port))
        taken.listen()
        result = footsense(
            *("run", "--config", file, "--duration", "1"),
            *("--record", tmp_path / "a.mcap", "--can-log", tmp_path / "a.log"),
        )
    assert f"127.0.0.1:{port}" in one_line_error(result, 2)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["robot.yaml"]


def test_a_service_that_requires_its_place_refuses_to_start_without(tmp_path: Path) -> None:
    """One line says what was not granted and which key asks for it, before any bus is opened; exit 2."""
    asked = "realtime: {cpu: 1023, required: true}\n"
    line = one_line_error(footsense("run", "--config", robot(tmp_path, device="/dev/i2c-77", more=asked)), 2)
    assert line.startswith("realtime.required: processor 1023 was not granted: this process may use ")
