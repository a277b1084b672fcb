"""Trials of the I2C bus: transfers that fail, lines that are held, adapters that go and come."""

import pytest

from firmware_interface.can.codes import NODE_IDS, Cause, State
from tests.kernel.robot import CONFIG, Trial, matching

_ERRORS = ("ENXIO", "ETIMEDOUT", "EAGAIN", "EIO", "SILENT")
_PLUGGED = "/sys/module/feet_adapter/parameters/plugged"


@pytest.mark.parametrize("error", [error for error in _ERRORS if error != "SILENT"])
def test_one_leg_fails(trial: Trial, error: str) -> None:
    """Every transfer to rm ends with {error}."""
    pid = trial.robot.pid
    trial.chips.do(f"fail rm {error}")
    trial.can.wait_for(State.ABSENT, ["rm"])
    trial.can.wait_for(State.VALID, set(NODE_IDS) - {"rm"})
    trial.chips.do("clear")
    trial.recovered()
    assert set(trial.can.causes(trial.mark)) == {"rm"}
    assert trial.robot.pid == pid


@pytest.mark.parametrize("error", ["EREMOTEIO", *_ERRORS])
def test_every_transfer_fails(trial: Trial, error: str) -> None:
    """Every transfer on the bus ends with {error} for 2 s."""
    pid = trial.robot.pid
    trial.chips.do(f"fail all {error}")
    trial.can.wait_for(State.ABSENT)
    trial.machine.run("sleep 2")
    trial.chips.do("clear")
    trial.recovered()
    assert trial.robot.pid == pid


@pytest.mark.parametrize("error", ["EREMOTEIO", "SILENT"])
def test_multiplexer_fails(trial: Trial, error: str) -> None:
    """Every transfer to the multiplexer ends with {error} for 2 s."""
    pid = trial.robot.pid
    trial.chips.do(f"fail mux {error}")
    trial.can.wait_for(State.ABSENT)
    trial.machine.run("sleep 2")
    trial.chips.do("clear")
    trial.recovered()
    assert trial.robot.pid == pid


def test_held_line_without_reset(trial: Trial) -> None:
    """A leg, lm, holds SDA for 3 s; no RESET pin."""
    pid = trial.robot.pid
    trial.chips.do("hold lm")
    trial.can.wait_for(State.ABSENT)
    trial.machine.run("sleep 3")
    trial.chips.do("clear")
    trial.recovered()
    assert trial.robot.pid == pid
    assert Cause.BUS_STUCK in trial.can.causes(trial.mark)["lm"]


def test_held_line_with_reset(trial: Trial) -> None:
    """A leg, lm, holds SDA; RESET of the multiplexer on a GPIO."""
    run = trial.machine.run
    run(
        "groupadd --system --force gpio; udevadm trigger --subsystem-match=gpio; udevadm settle\n"
        "mkdir -p /etc/systemd/system/footsense.service.d\n"
        "printf '[Service]\\nSupplementaryGroups=i2c gpio\\nDeviceAllow=char-gpiochip rw\\n'"
        " > /etc/systemd/system/footsense.service.d/reset.conf; systemctl daemon-reload\n"
        f"cp {CONFIG} {CONFIG}.before"
    )
    try:
        trial.robot.configure("s/# reset: .*/reset: {device: \\/dev\\/gpiochip0, line: 0}/")
        trial.can.wait_for(State.VALID)
        mark, (_, before) = trial.can.mark, trial.chips.counts
        trial.chips.do("hold lm")
        trial.can.wait_for(State.ABSENT, ["lm"])
        trial.can.wait_for(State.VALID, set(NODE_IDS) - {"lm"})
        run("sleep 2")
        pulses = trial.chips.counts[1] - before
        trial.chips.do("clear")
        trial.recovered()
        trial.row.shown = f"{trial.can.shown(mark)}; {pulses} RESET pulses"
        assert pulses > 0
        assert Cause.BUS_STUCK in trial.can.causes(mark)["lm"]
    finally:
        run(
            f"mv {CONFIG}.before {CONFIG}; rm /etc/systemd/system/footsense.service.d/reset.conf\n"
            "systemctl daemon-reload; systemctl restart footsense"
        )


def test_adapter_is_pulled(trial: Trial) -> None:
    """The I2C adapter is unplugged for 3 s."""
    pid, cursor = trial.robot.pid, trial.machine.journal_cursor
    before = trial.machine.run("echo /dev/i2c-*")
    trial.machine.run(f"echo 0 > {_PLUGGED}")
    trial.can.wait_for(State.ABSENT)
    trial.machine.run(f"sleep 3; echo 1 > {_PLUGGED}")
    trial.recovered()
    assert trial.robot.pid == pid
    assert len(trial.machine.journal(cursor)) < 40
    assert trial.machine.run("echo /dev/i2c-*") == before


def test_foreign_switches(trial: Trial) -> None:
    """Another program switches the multiplexer 150 times (`i2cset`)."""
    pid, cursor = trial.robot.pid, trial.machine.journal_cursor
    trial.machine.run("for n in $(seq 150); do i2cset -f -y 1 0x71 $((1 << n % 6)) || true; done")
    trial.recovered()
    assert trial.robot.pid == pid
    trial.row.shown = (
        f"{trial.can.shown(trial.mark)}; {len(trial.machine.journal(cursor))} lines in the journal"
    )


def test_servers_restart(trial: Trial) -> None:
    """All chips lose their power: they come back without their settings."""
    pid = trial.robot.pid
    trial.machine.run("systemctl restart chips")
    trial.recovered()
    assert trial.robot.pid == pid
    assert matching(trial.machine.run("systemctl is-active chips").splitlines(), "^active")
