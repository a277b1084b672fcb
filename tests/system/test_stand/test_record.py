"""A session on the stand: guided, recorded whole whatever goes wrong with its force sensor, and fit to calibrate by."""

import contextlib
import os
import re
import select
import signal
import subprocess
import sys
import tty
from pathlib import Path

import msgspec
import numpy as np
import pytest

from footsense.calibration.recorded_session import read_session
from footsense.daemon.foot_types import DEFAULT_FOOT_TYPE
from footsense.foot.calibration_files import read_calibration
from footsense.recording.replay import Replay
from footsense.sim.clock import VirtualClock
from footsense.sim.reference_sensor import SimulatedForceSensor
from footsense.sim.scene import load_scene
from tests.system.command import TIMEOUT_S, footsense, one_line_error

pytestmark = pytest.mark.slow

RING_N = [[0.25, 0.0, 0.43], [-0.125, 0.22, 0.43], [-0.125, -0.22, 0.43]]
SIX = RING_N + [[2 * x, 2 * y, 2 * z] for x, y, z in RING_N]

SENSOR = """
sensor: {kind: simulated, linearity_rel: 0.0}
axes: {x: -x, y: -y, z: -z}
units: gf
rated: [4000, 4000, 8000]
latency_ms: 2.1
"""


def scene(folder: Path, presses: list[list[float]], dwell_s: float = 0.6) -> Path:
    """Write a scene of these presses."""
    path = folder / "presses.yaml"
    load = {"kind": "calibration_loads", "presses": presses, "dwell_s": dwell_s}
    text = {"description": "presses", "load": load, "effects": {"converter_noise": True, "gap_contact": True}}
    path.write_bytes(msgspec.yaml.encode(text))
    return path


def stand(folder: Path, text: str = SENSOR) -> Path:
    """Write a test stand's file."""
    path = folder / "test-stand.yaml"
    path.write_text(text)
    return path


def test_a_session_ends_with_a_set_that_is_enough(tmp_path: Path) -> None:
    """Six presses make a set of five; their forces are those of the stick, and the recording replays bit for bit."""
    out = tmp_path / "one.mcap"
    done = footsense(
        *(
            "test-stand",
            "record",
            "--reference",
            stand(tmp_path),
            "--foot",
            "foot-0007",
            "--leg",
            "rm",
            "--loads",
            "5",
        ),
        *("--scene", scene(tmp_path, SIX + SIX), "--session", "a", out),
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert re.fullmatch(
        r"press 2: 0\.(49|50|51) N towards azimuth 1(19|20|21), elevation (59|60|61) deg", lines[1]
    )
    assert lines[6].startswith(f"{out}: 6 loads, at least 5 wanted; directions covered: 100 % at 0.5 N")
    assert ", missing 0, bad records 0, saturated 0," in " ".join(done.stdout.split())
    header = Replay(out).header
    assert (header["foot"], header["session"], header["leg"]) == ("foot-0007", "a", "rm")
    assert msgspec.json.decode(header["reference"])["units"] == "gf"
    session = read_session(out, "foot-0007")
    error_n = session.loads.force_n - SIX
    assert np.abs(error_n).max() < 0.03
    assert footsense("replay", "--check", out).returncode == 0


def test_a_reference_that_contradicts_the_foot_is_reported(tmp_path: Path) -> None:
    """Wrong units and swapped axes are said as soon as they are known, and at the end; `calibrate` refuses them too."""
    out = tmp_path / "one.mcap"
    wrong = SENSOR.replace("units: gf", "units: kgf").replace("{x: -x, y: -y, z: -z}", "{x: y, y: -x, z: -z}")
    done = footsense(
        *("test-stand", "record", "--reference", stand(tmp_path, wrong), "--foot", "foot-0007"),
        *("--scene", scene(tmp_path, SIX), out),
    )
    assert done.returncode == 65
    last = done.stderr.splitlines()[-1]
    calibrating = footsense(
        "test-stand", "calibrate", out, "--foot", "foot-0007", "--calibrations", tmp_path / "feet"
    )
    refused = one_line_error(calibrating, 65)
    assert last.startswith(f"footsense: {out} is kept, but do not calibrate with it: ")
    for words in (
        "its readings seem to be in gf, and the test stand's file says units: kgf",
        "axes: {x: -x, y: -y, z: -z} would fit",
    ):
        assert words in done.stdout
        assert words in last
        assert words in refused
    assert not (tmp_path / "feet").exists()


@pytest.mark.parametrize(
    ("text", "options", "exit_code", "says"),
    [
        (SENSOR, ("--foot", "seven"), 78, "--foot seven: is no identity of a foot, such as foot-0007"),
        (SENSOR.replace("gf", "kg"), ("--foot", "foot-0007"), 78, "did you mean kgf?"),
        (
            SENSOR.replace(
                "kind: simulated, linearity_rel: 0.0",
                "kind: serial, device: /dev/none, rate_hz: 200, columns: [fx, fy, fz]",
            ),
            ("--foot", "foot-0007"),
            69,
            "/dev/none: No such file or directory",
        ),
    ],
)
def test_what_cannot_begin_leaves_nothing_behind(
    tmp_path: Path, text: str, options: tuple[str, ...], exit_code: int, says: str
) -> None:
    """One line, the right exit code, and no file."""
    out = tmp_path / "one.mcap"
    done = footsense("test-stand", "record", "--reference", stand(tmp_path, text), *options, out)
    assert says in one_line_error(done, exit_code)
    assert not list(tmp_path.glob("one*"))


def test_a_terminal_and_a_sensor_on_a_line(tmp_path: Path) -> None:
    """Presses are drawn as they happen; the sensor is unplugged, the recording goes on, and Ctrl-C leaves it whole.

    However slowly the simulated foot is played, the sensor feels what the foot does, since it lives in the time that
    the picture shows. A press that counts for nothing where the machine stands still is made again.
    """
    path, out = scene(tmp_path, 20 * SIX, dwell_s=0.8), tmp_path / "one.mcap"
    stick = load_scene(str(path)).load.build(1_000_000_000)
    clock = VirtualClock()
    sensor = SimulatedForceSensor(lambda t_ns: stick.contact("lf", t_ns).force_n, clock, 1, 0.0)
    line, its_end = os.openpty()
    tty.setraw(its_end)
    described = f"""kind: serial, device: {os.ttyname(its_end)}, rate_hz: 200, start: "S\\r\\n",
      columns: [time_us, fx, fy, fz]"""
    file = stand(tmp_path, SENSOR.replace("kind: simulated, linearity_rel: 0.0", described))
    terminal, screen = os.openpty()
    process = subprocess.Popen(
        [
            *(
                sys.executable,
                "-m",
                "footsense",
                "test-stand",
                "record",
                "--reference",
                file,
                "--foot",
                "foot-0007",
            ),
            *("--scene", path, "--loads", "50", out),
        ],
        stdin=screen,
        stdout=screen,
        stderr=screen,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100", "LINES": "40"},
    )
    os.close(screen)
    drawn, asked = b"", b""
    try:
        while not re.search(rb"[6-9] loads, at least 50", drawn):
            ready, _, _ = select.select([terminal, line], [], [])
            if line in ready:
                asked += os.read(line, 64)
                sensor.write(b"S")
            if terminal in ready:
                drawn += os.read(terminal, 65536)
                if shown_s := re.findall(rb"session one, (\d+\.\d) s", drawn[-65536:]):
                    clock.sleep_until_ns(round(float(shown_s[-1]) * 1e9))
                    os.write(line, sensor.read())
        os.close(line)
        while b": gone" not in drawn:
            drawn += os.read(terminal, 65536)
        process.send_signal(signal.SIGINT)
        with contextlib.suppress(OSError):  # its end of the terminal is closed when it ends
            while True:
                drawn += os.read(terminal, 65536)
        process.wait(TIMEOUT_S)
    finally:
        process.kill()
        process.wait(TIMEOUT_S)
        os.close(terminal)
        os.close(its_end)
    assert asked == b"S\r\n"
    assert process.returncode == 0, drawn[-2000:]
    for words in (
        b" % at 0.5 N",
        b"press here next",
        b"reference",
        b"next",
        b"not complete; next would be",
        b"stream starts 1",
    ):
        assert words in drawn
    session = read_session(out, "foot-0007")
    assert session.name == "one"
    assert not session.damage
    for load_n in session.loads.force_n:
        assert min(np.abs(load_n - force_n).max() for force_n in np.array(SIX)) < 0.04
    feet = tmp_path / "feet"
    calibrating = footsense("test-stand", "calibrate", out, "--foot", "foot-0007", "--calibrations", feet)
    assert calibrating.returncode == 0, calibrating.stderr
    assert read_calibration(feet / "foot-0007", DEFAULT_FOOT_TYPE).manifest.n_loads == len(session.loads)
