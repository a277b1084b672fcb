"""Trials of the I2C buses: transfers that fail, lines that are held, adapters that go and come, a dip of the supply."""

import pytest

from firmware_interface.can.codes import Cause, State
from footsense.frames import LEGS
from tests.kernel.robot import LEFT, RIGHT, Trial

#: SILENT: the transfer ends with the adapter's timeout.
_ERRORS = ("ENXIO", "EAGAIN", "EIO", "SILENT")
_TIMEOUTS = {"EAGAIN", "SILENT"}
#: States of the legs of another bus: while three legs are set up, a frame may come late and lack a reading.
_USABLE = {State.VALID, State.DEGRADED}
_PLUGGED = "/sys/module/feet_adapter/parameters/plugged"


@pytest.mark.parametrize("error", _ERRORS[1:])  # without an acknowledge: in the short form
def test_one_leg_fails(trial: Trial, error: str) -> None:
    """Every transfer to rm ends with {error}."""
    pid = trial.robot.pid
    trial.chips.do(f"fail rm {error}")
    trial.can.wait_for(State.ABSENT, ["rm"])
    trial.can.wait_for(State.VALID, set(LEGS) - {"rm"})
    trial.chips.do("clear")
    trial.recovered()
    causes = trial.can.causes(trial.mark)
    assert causes.pop("rm") & {Cause.NO_ANSWER, Cause.BUS_STUCK}
    # A timeout costs time that the others of its bus miss, once.
    assert set(causes) <= (set(RIGHT) if error in _TIMEOUTS else set())
    assert trial.robot.pid == pid


@pytest.mark.parametrize("error", _ERRORS)
def test_a_bus_fails(trial: Trial, error: str) -> None:
    """Every transfer on /dev/i2c-3 ends with {error} until its legs are absent."""
    pid = trial.robot.pid
    trial.chips.do(f"fail i2c-3 {error}")
    trial.can.wait_for(State.ABSENT, RIGHT)
    trial.chips.do("clear")
    trial.recovered()
    assert set(trial.can.causes(trial.mark)) == set(RIGHT)
    assert trial.can.all_states(trial.mark, LEFT) <= _USABLE
    assert trial.robot.pid == pid


def test_held_line(trial: Trial) -> None:
    """A leg, lm, holds SDA of /dev/i2c-1 for 2 s."""
    pid = trial.robot.pid
    trial.chips.do("hold lm")
    trial.can.wait_for(State.ABSENT, LEFT)
    trial.machine.run("sleep 2")
    trial.chips.do("clear")
    trial.recovered()
    assert all(Cause.BUS_STUCK in trial.can.causes(trial.mark)[leg] for leg in LEFT)
    assert trial.can.all_states(trial.mark, RIGHT) <= _USABLE
    assert trial.robot.pid == pid


def test_supply_dips(trial: Trial) -> None:
    """A dip of the supply resets all converters, with lr pressed."""
    pid = trial.robot.pid
    trial.press("lr")
    mark = trial.can.mark
    trial.chips.do("dip")
    trial.recovered()
    trial.row.shown = trial.can.shown(mark)
    assert trial.can.causes(mark)
    forces = [force for frame in trial.can.since(mark) if frame.leg == "lr" and (force := frame.force)]
    pressed_n = [force.force_n[2] for force in forces if force.state is State.VALID]
    assert pressed_n == pytest.approx([0.8] * len(pressed_n), abs=0.05)
    assert trial.robot.pid == pid


@pytest.mark.parametrize(
    ("plugged", "which", "legs"), [(1, "of the right legs", RIGHT), (0, "of all legs", LEGS)]
)
def test_adapter_is_pulled(trial: Trial, plugged: int, which: str, legs: tuple[str, ...]) -> None:
    """The I2C adapter {which} is unplugged until they are absent."""
    del which
    pid, cursor = trial.robot.pid, trial.machine.journal_cursor
    before = trial.machine.run("echo /dev/i2c-*")
    trial.machine.run(f"echo {plugged} > {_PLUGGED}")
    trial.can.wait_for(State.ABSENT, legs)
    trial.machine.run(f"echo 3 > {_PLUGGED}")
    trial.recovered()
    assert trial.robot.pid == pid
    assert set(trial.can.causes(trial.mark)) == set(legs)
    assert len(trial.machine.journal(cursor)) < 40
    assert trial.machine.run("echo /dev/i2c-*") == before
