"""The short form: deployment, forces on CAN, and one of each kind of trouble."""

import pytest

from firmware_interface.can.codes import Cause, Flag, State
from firmware_interface.can.force import QUALITY, QUALITY_ID
from tests.kernel import deploy_page
from tests.kernel.can_stream import LEGS
from tests.kernel.robot import Robot, Trial, matching


def test_feet_answer(first_trial: Trial) -> None:
    """Section 2 of deploy/README.md: `i2cdetect` of the left feet; with a multiplexer, before and after a selection."""
    robot = first_trial.robot
    robot.execute_section(2)
    feet, before, after = (set(output.split()) for output in robot.outputs["i2cdetect -y 1"])
    assert {"2c", "2d", "2e"} <= feet
    assert {"49", "50"} & before == set()
    assert {"49", "50", "71"} <= after
    first_trial.row.shown = "0x2c, 0x2d and 0x2e; 0x71, then also 0x49 and 0x50"


def test_deployment(first_trial: Trial, deployed: Robot) -> None:
    """Sections 3 to 5 of deploy/README.md."""
    first_trial.can.wait_for(State.VALID)
    assert "active (running)" in deployed.output_of("systemctl status footsense")
    assert "footsense_up 1" in deployed.output_of("curl")
    assert "can0  109" in deployed.output_of("candump can0")
    executed = {command.section for command in deploy_page.commands()}
    assert {section.partition(".")[0] for section in executed} == {"1", "2", "3", "4", "5"}


def test_a_pressed_foot(trial: Trial) -> None:
    """Foot of lr pressed with (0.05, 0, 0.8) N."""
    trial.press("lr")
    forces = trial.can.forces(trial.mark)
    for leg in set(LEGS.values()) - {"lr"}:
        assert forces[leg].force_n == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    trial.row.shown = "lr (" + ", ".join(f"{part:.2f}" for part in forces["lr"].force_n) + ") N, others 0"
    qualities = [frame for frame in trial.can.since(trial.mark) if frame.can_id - QUALITY_ID in LEGS]
    assert qualities
    assert not any(QUALITY.decode(frame.can_id, frame.data).flags & Flag.SIMULATED for frame in qualities)


def test_killed(trial: Trial) -> None:
    """Service killed (SIGKILL)."""
    pid = trial.robot.pid
    trial.machine.run(f"kill -9 {pid}")
    trial.recovered()
    assert trial.robot.pid not in {0, pid}


def test_can_goes_and_comes(trial: Trial) -> None:
    """can0 deleted for 2 s."""
    pid, cursor = trial.robot.pid, trial.machine.journal_cursor
    trial.machine.run("ip link del can0; sleep 2; ip link add can0 type vcan; ip link set can0 up")
    trial.recovered()
    assert trial.robot.pid == pid
    assert matching(trial.machine.journal(cursor), "can0")


def test_a_leg_that_does_not_answer(trial: Trial) -> None:
    """Every transfer to lm fails with EREMOTEIO."""
    others = set(LEGS.values()) - {"lm"}
    trial.chips.do("fail lm EREMOTEIO")
    trial.can.wait_for(State.ABSENT, ["lm"])
    trial.can.wait_for(State.VALID, others)
    trial.chips.do("clear")
    trial.recovered()
    causes = trial.can.causes(trial.mark)
    assert Cause.NO_ANSWER in causes["lm"]
    assert set(causes) == {"lm"}


def test_removed_and_installed_again(trial: Trial) -> None:
    """`footsense install --remove`, `footsense install` and `systemctl enable --now` on the running machine."""
    footsense, run = "/opt/footsense/bin/footsense", trial.machine.run
    run(f"{footsense} install --remove")
    left = run(
        "ls /etc/systemd/system /etc/systemd/network /etc/footsense; systemctl is-enabled systemd-networkd || true"
    )
    assert matching(left.splitlines(), r"footsense.*\.service$|80-can0|installed") == []
    assert "disabled" in left
    said = run(f"{footsense} install")
    assert "warning" not in said
    run("systemctl enable --now footsense footsense-exporter footsense-view")
    trial.recovered()
    assert run(f"{footsense} install").splitlines()[0] == "nothing to do"
