"""The examples with a robot or a sensor beside footsense, run as their users would."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from itertools import islice, takewhile
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tests.contract.c_decoder import SOURCES, compile_c
from tests.system.command import footsense, robot

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
TIMEOUT_S = 120


def run_example(name: str, *arguments: str | Path, **environment: str) -> str:
    """Run an example to its end; return what it prints."""
    done = subprocess.run(
        [sys.executable, "-W", "error", EXAMPLES / name, *arguments],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@contextlib.contextmanager
def running(command: Sequence[str | Path], **environment: str) -> Iterator[subprocess.Popen[str]]:
    """Run a command until it is interrupted."""
    # A program started where SIGINT is ignored, as in the background of a shell, would ignore it too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with subprocess.Popen(
        command,
        env=os.environ | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=TIMEOUT_S)


def running_example(
    name: str, *arguments: str | Path, **environment: str
) -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
    return running([sys.executable, EXAMPLES / name, *arguments], **environment)


@pytest.mark.slow
def test_a_robot_in_mujoco_walks_and_its_feet_publish(tmp_path: Path) -> None:
    told = run_example("mujoco_foot.py", tmp_path / "foot.png", MPLBACKEND="Agg")
    walked_m, usable_percent = map(float, re.findall(r"(\d+\.\d+)", told))
    assert walked_m > 0.15
    assert 90.0 < usable_percent < 99.9
    assert (tmp_path / "foot.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_robot_is_followed_best_by_its_force_vectors() -> None:
    told = run_example("odometry.py")
    drifts = dict(re.findall(r"^(.+): ([\d.]+)%$", told, re.MULTILINE))
    by_vector, by_axis, by_flag = (
        float(drifts[name]) for name in ("force vectors", "one-axis sensors", "contact flags")
    )
    assert by_vector < 1.5
    assert by_vector < by_axis
    assert by_flag > 2.0 * by_vector


@pytest.mark.slow
def test_a_controller_in_c_lets_no_tripod_swing_on_feet_that_it_does_not_know(tmp_path: Path) -> None:
    log, program = tmp_path / "walk.log", tmp_path / "gait_controller"
    footsense("run", "--scene", "faults", "--duration", "5", "--fast", "--summary", "json", "--can-log", log)
    sources = [EXAMPLES / "gait_controller.c", *SOURCES.glob("footsense_*.c")]
    compile_c(tmp_path, "-I", SOURCES, *sources, "-o", program)
    with log.open("rb") as frames:
        told = subprocess.run([program], stdin=frames, capture_output=True, text=True, check=True).stdout
    found = [(float(t_s), text) for t_s, text in re.findall(r"^ *([\d.]+) s  (.*)$", told, re.MULTILINE)]
    walked = [text for t_s, text in found if t_s < 2.0]
    assert set(walked[:6]) == {f"{leg} used: link 1, state 1" for leg in ("lf", "lm", "lr", "rf", "rm", "rr")}
    assert {"left tripod may swing", "right tripod may swing", "right tripod has to stand"} <= set(walked)
    # lf loses an element at 2.0 s, lm a column at 2.5 s: one of each tripod. rf is gone from 3.5 s on.
    since = {text: t_s for t_s, text in reversed(found)}
    assert 2.0 < since["lf refused: link 1, state 7"] < 2.1
    assert 2.5 < since["lm refused: link 1, state 7"] < 2.6
    assert 3.5 < since["rf refused: link 1, state 0"] < 3.6
    assert not [text for t_s, text in found if t_s > 2.6 and "may swing" in text]
    of_another_form = subprocess.run(
        [program], input="  can0  109   [8]  00 01\n", capture_output=True, text=True, check=False
    )
    told = "no line of candump -L seen; use: candump -L can0 | ./gait_controller\n"
    assert (of_another_form.returncode, of_another_form.stdout, of_another_form.stderr) == (1, "", told)


@pytest.mark.slow
def test_a_sensor_without_a_driver_is_recorded_beside_a_foot(tmp_path: Path) -> None:
    """Its presses of 1 N, with the sign of the force on the foot, each sample once."""
    stand, out = tmp_path / "stand.yaml", tmp_path / "session.mcap"
    with running_example("own_reference_sensor.py", stand) as sensor:
        assert sensor.stdout is not None
        assert sensor.stdout.readline().startswith(f"{stand}: the sensor is /dev/")
        options = ("--foot", "foot-0007", "--scene", "hanging", "--duration", "5")
        footsense("test-stand", "record", "--reference", stand, *options, out)
    assert sensor.returncode == 0
    command = [sys.executable, str(EXAMPLES / "own_reference_sensor.py"), str(stand)]
    again = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    told = f"{stand}: exists and is not overwritten; choose another name or remove it\n"
    assert (again.returncode, again.stderr) == (1, told)
    with out.open("rb") as stream:
        found = [
            json.loads(message.data) for _, _, message in make_reader(stream).iter_messages(["/reference"])
        ]
    forces_n = sorted(sample["fz_n"] for sample in found)
    assert len(found) > 400
    assert forces_n[0] == 0.0
    assert forces_n[-1] == pytest.approx(1.0, abs=0.001)
    assert {(sample["fx_n"], sample["fy_n"], sample["saturated"]) for sample in found} == {(0.0, 0.0, False)}


@pytest.mark.slow
def test_a_ros2_node_tells_each_load_and_what_is_not_known_any_more(tmp_path: Path) -> None:
    """Through the relay, which is the router here, and passes on the topics of which this ROS has the types."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        router = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    here = {
        "ZENOH_CONFIG_OVERRIDE": f'connect/endpoints=["{router}"];connect/retry={{period_init_ms:100}}',
        "STAND_IN_ROUTER": router,
        "ROS_DOMAIN_ID": str(100 + os.getpid() % 100),
        "PYTHONPATH": os.pathsep.join(map(str, (ROOT / "tests/examples/ros2_stand_in", ROOT))),
    }
    config = robot(tmp_path, interface="udp_multicast", channel=f"239.74.164.{os.getpid() % 250 + 1}")
    service = [sys.executable, "-m", "footsense"]
    with (
        running([*service, "ros2", "--config", config], **here),
        running_example("ros2_node.py", **here) as node,
        running_example("ros2_relay.py", router, **here) as relay,
        running([*service, "run", "--config", config, "--realtime", "--summary", "json"]) as walk,
    ):
        assert node.stdout is not None
        # Ten lines a second.
        told = (dict(re.findall(r"(\w\w) (unknown|-?[\d.]+ N)", line)) for line in islice(node.stdout, 600))
        assert any(legs["lf"] != "unknown" and float(legs["lf"].removesuffix(" N")) > 0.3 for legs in told)
        assert any(legs["lf"] != "unknown" and float(legs["lf"].removesuffix(" N")) < 0.05 for legs in told)
        walk.send_signal(signal.SIGINT)
        assert any(set(legs.values()) == {"unknown"} for legs in told)
        assert relay.stdout is not None
        passed_on = list(takewhile(lambda line: "/lift_off" not in line, relay.stdout))
    assert "/footsense/lf/wrench geometry_msgs/msg/WrenchStamped 76 bytes\n" in passed_on
    left_out = "/footsense/lf/contact is left out: this ROS has no whole_body_state_msgs/msg/ContactState\n"
    assert left_out in passed_on
