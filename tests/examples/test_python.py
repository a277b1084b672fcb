"""The examples of the Python interface, run as their users would: beside a simulated robot, or on arrays."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import footsense
from tests.examples.test_robots import EXAMPLES, run_example
from tests.system.command import robot
from tests.system.daemon import Daemon, running

GOLDEN = Path(__file__).parents[1] / "golden/measured_walk.mcap"
TIMEOUT_S = 60
PRESSED = """
description: Every foot is pressed a second after the start.
load: {kind: constant, force_n: [0.1, 0.0, 0.5]}
lead_in_s: 1.0
"""


@contextmanager
def walking(folder: Path, channel: str, *arguments: str | Path) -> Iterator[Daemon]:
    """Run a simulated robot that is heard on a multicast address, and obeys."""
    file = robot(folder, interface="udp_multicast", channel=f"{channel}, commands: true")
    with running(folder, "--config", file, *arguments) as service:
        service.wait_until_ready()
        yield service


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "channel", "wanted"),
    [
        (
            "read_forces.py",
            "239.74.163.101",
            r"lf: .* 0\.[3-9]\d\d N, z \+- 0\.\d+ N, +\d+\.\d ms old, contact$",
        ),
        ("touchdown.py", "239.74.163.102", r"lf: lift-off after [01]\.\d\d s$"),
        ("asyncio_forces.py", "239.74.163.106", r"lf: touchdown$"),
    ],
)
def test_a_program_beside_a_walking_robot_ends_with_it(
    tmp_path: Path, name: str, channel: str, wanted: str
) -> None:
    with walking(tmp_path, channel) as service:
        command = [sys.executable, "-W", "error", "-u", str(EXAMPLES / name), "--can", channel]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
            assert program.stdout is not None
            assert any(re.match(wanted, line.rstrip()) for line in program.stdout), program.communicate()
            service.stop()
            _, errors = program.communicate(timeout=TIMEOUT_S)
    assert (program.returncode, errors) == (0, "")


@pytest.mark.parametrize("name", ["asyncio_forces.py", "read_forces.py", "touchdown.py", "tare.py"])
def test_a_robot_that_is_not_there_is_one_line(name: str) -> None:
    command = [sys.executable, str(EXAMPLES / name), "--can", "can77"]
    program = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    assert (program.returncode, program.stdout) == (1, "")
    assert re.fullmatch(r"[^\n]*can77[^\n]*; of a simulation: 239\.74\.163\.2\n", program.stderr)


@pytest.mark.slow
def test_feet_in_the_air_are_tared(tmp_path: Path) -> None:
    with walking(tmp_path, "239.74.163.103", "--scene", "hanging"):
        told = run_example("tare.py", "--can", "239.74.163.103").splitlines()
        with footsense.connect("239.74.163.103") as feet:
            feet.stop("lf")
            stopped = next(forces for forces in feet if not forces["lf"].usable)
            feet.start("lf")
            assert any(forces["lf"].usable for forces in feet)
    assert (stopped["lf"].state, stopped["rf"].usable) == (footsense.State.STOPPED, True)
    assert len(told) == 2
    assert all(re.fullmatch(r"[lr]f: tared; reads -?\d\.\d mN now", line) for line in told)


@pytest.mark.slow
def test_the_tare_of_loaded_feet_is_refused_in_words(tmp_path: Path) -> None:
    scene = tmp_path / "pressed.yaml"
    scene.write_text(PRESSED)
    with walking(tmp_path, "239.74.163.104", "--scene", scene) as service:
        service.live_on(20)  # the feet are down
        command = [sys.executable, str(EXAMPLES / "tare.py"), "--can", "239.74.163.104"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
        with footsense.connect("239.74.163.104") as feet:
            for _ in range(2):  # the second at once, and answered too
                with pytest.raises(
                    footsense.FootsenseError, match=r"^lf, rf: not tared: the foot is in contact"
                ):
                    feet.tare()
            with pytest.raises(footsense.FootsenseError, match=r"^lf: not stopped: the foot is in contact"):
                feet.stop("lf")
    refusal = ": not tared: the foot is in contact, or reads otherwise than a free one; lift it "
    assert done.returncode == 1
    assert [line[2:][: len(refusal)] for line in done.stdout.splitlines()] == [refusal] * 2


@pytest.mark.slow
def test_a_program_whose_reader_goes_says_nothing(tmp_path: Path) -> None:
    """As in `read_forces.py | head`."""
    with walking(tmp_path, "239.74.163.105"):
        command = [sys.executable, "-u", str(EXAMPLES / "read_forces.py"), "--can=239.74.163.105"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
            assert program.stdout is not None
            assert program.stdout.readline().startswith("lf: ")
            program.stdout.close()
            assert program.wait(TIMEOUT_S) == -signal.SIGPIPE
            assert program.stderr is not None
            assert program.stderr.read() == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "missing", "says"),
    [
        ("plot_recording.py", "", "walk.mcap: "),
        ("plot_recording.py", "matplotlib", "plot_recording.py needs matplotlib: pip install matplotlib"),
        ("mujoco_foot.py", "mujoco", r"mujoco_foot.py needs mujoco; .*: pip install .* -e '.\[walkers\]'"),
        ("odometry.py", "mujoco", r"odometry.py needs mujoco; .*: pip install .* -e '.\[lab\]'"),
        ("ros2_node.py", "rclpy", "ros2_node.py needs rclpy: run it in a shell with ROS 2"),
        ("odometry.py", "numpy", r"odometry.py needs numpy; .*: pip install .* -e '.\[lab\]'"),
        ("mujoco_foot.py", "numpy", r"mujoco_foot.py needs numpy; .*: pip install .* -e '.\[walkers\]'"),
    ],
)
def test_an_example_says_in_one_line_what_is_missing(
    tmp_path: Path, name: str, missing: str, says: str
) -> None:
    program = (
        f"import runpy, sys; sys.modules[{missing!r}] = None; sys.argv = [{name!r}]; "
        f"runpy.run_path({str(EXAMPLES / name)!r}, run_name='__main__')"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )
    assert done.returncode == 1
    assert re.match(says, done.stderr)
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "estimate_array.py",
        "mujoco_foot.py",
        "odometry.py",
        "own_reference_sensor.py",
        "plot_recording.py",
        "simulate_foot.py",
    ],
)
def test_an_example_that_is_asked_for_help_gives_that_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_example(name, "--help").startswith(f"usage: {name} [-h]")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_recording_is_drawn(tmp_path: Path) -> None:
    told = run_example("plot_recording.py", GOLDEN, tmp_path / "walk.png", MPLBACKEND="Agg")
    assert re.findall(r"usable (\d\d)% .* contact (\d\d)%", told)[0] == ("99", "56")
    assert (tmp_path / "walk.png").read_bytes().startswith(b"\x89PNG")
    command = [sys.executable, str(EXAMPLES / "plot_recording.py"), str(GOLDEN), str(tmp_path / "walk.txt")]
    refused = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    assert re.fullmatch(r".*walk\.txt: Format 'txt' is not supported.*\n", refused.stderr)


def test_a_foot_is_pressed_and_its_readings_give_the_forces_back() -> None:
    assert "\n [8.17 7.62 8.17]]" in run_example("simulate_foot.py")
    told = run_example("estimate_array.py")
    assert told.startswith("usable: 100% of 400 rows, in contact: 100%")
    wrong_mn = [float(figure) for figure in re.findall(r"wrong by (\d+\.\d) mN", told)]
    assert len(wrong_mn) == 3
    assert max(wrong_mn) < 10.0
