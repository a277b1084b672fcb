"""Trials of the I2C bus: transfers that fail, lines that are held, adapters that go and come."""

import pytest

from firmware_interface.can.codes import Cause, State
from footsense.frames import LEGS
from tests.kernel.robot import CONFIG, Trial

#: SILENT: the transfer ends with the adapter's timeout.
_ERRORS = ("ENXIO", "EREMOTEIO", "ETIMEDOUT", "EAGAIN", "EIO", "SILENT")
_TIMEOUTS = {"ETIMEDOUT", "EAGAIN", "SILENT"}
_PLUGGED = "/sys/module/feet_adapter/parameters/plugged"
_ADAPTER = "/sys/bus/i2c/devices/i2c-1"


@pytest.mark.parametrize("error", [error for error in _ERRORS if error != "EREMOTEIO"])  # in the short form
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
    # A timeout costs time that the others miss, once.
    assert set().union(*causes.values()) <= ({Cause.DELAYED} if error in _TIMEOUTS else set())
    assert trial.robot.pid == pid


@pytest.mark.parametrize("error", _ERRORS)
@pytest.mark.parametrize(("chips", "where"), [("all", "on the bus"), ("mux", "to the multiplexer")])
def test_every_transfer_fails(trial: Trial, chips: str, where: str, error: str) -> None:
    """Every transfer {where} ends with {error} until all legs are absent."""
    pid = trial.robot.pid
    trial.chips.do(f"fail {chips} {error}")
    trial.can.wait_for(State.ABSENT)
    trial.chips.do("clear")
    trial.recovered()
    assert trial.robot.pid == pid


def test_held_line_with_reset(trial: Trial) -> None:
    """A leg, lm, holds SDA; RESET of the multiplexer on a GPIO."""
    run = trial.machine.run
    footsense = "/opt/footsense/bin/footsense"
    run(f"cp {CONFIG} {CONFIG}.before")
    try:
        run(
            f"sed -i 's/# reset: .*/reset: {{device: \\/dev\\/gpiochip0, line: 0}}/' {CONFIG}; {footsense} install"
        )
        trial.robot.configure()
        trial.can.wait_for(State.VALID)
        mark, (_, before) = trial.can.mark, trial.chips.counts
        trial.chips.do("hold lm")
        trial.can.wait_for(State.ABSENT, ["lm"])
        trial.can.wait_for(State.VALID, set(LEGS) - {"lm"})
        pulses = trial.chips.counts[1] - before
        trial.chips.do("clear")
        trial.recovered()
        trial.row.shown = f"{trial.can.shown(mark)}; {pulses} RESET pulses"
        assert pulses > 0
        assert Cause.BUS_STUCK in trial.can.causes(mark)["lm"]
    finally:
        run(f"mv {CONFIG}.before {CONFIG}; {footsense} install\nsystemctl restart footsense")


def test_adapter_is_pulled(trial: Trial) -> None:
    """The I2C adapter is unplugged until all legs are absent."""
    pid, cursor = trial.robot.pid, trial.machine.journal_cursor
    before = trial.machine.run("echo /dev/i2c-*")
    trial.machine.run(f"echo 0 > {_PLUGGED}")
    trial.can.wait_for(State.ABSENT)
    trial.machine.run(f"echo 1 > {_PLUGGED}")
    trial.recovered()
    assert trial.robot.pid == pid
    assert len(trial.machine.journal(cursor)) < 40
    assert trial.machine.run("echo /dev/i2c-*") == before


def test_the_kernel_has_the_multiplexer(trial: Trial) -> None:
    """Multiplexer driven by the kernel (i2c-mux-pca954x), lr pressed, then lm holds SDA for 2 s."""
    run = trial.machine.run
    # A fresh adapter: a timeout that footsense has set outlives it.
    run(
        f"systemctl stop footsense; cp {CONFIG} {CONFIG}.before\n"
        f"echo 0 > {_PLUGGED}; until [ ! -e {_ADAPTER} ]; do sleep 0.1; done; echo 1 > {_PLUGGED}\n"
        f"modprobe -a i2c-mux i2c-mux-pca954x; echo pca9548 0x71 > {_ADAPTER}/new_device"
    )
    try:
        run(
            "udevadm settle; channel=0; buses=; for leg in lf lm lr rf rm rr; do\n"
            f"bus=$(basename $(readlink -f {_ADAPTER}/1-0071/channel-$channel)); channel=$((channel + 1))\n"
            'buses="$buses  - {device: /dev/$bus, leg: $leg}\\n"; done\n'
            'awk -v buses="$buses" '
            "'/^buses:/ {print; printf buses; skip = 1; next} /^[a-z]/ {skip = 0} !skip' "
            f"{CONFIG}.before > {CONFIG}; systemctl start footsense"
        )
        trial.can.wait_for(State.VALID)
        pid, mark = trial.robot.pid, trial.can.mark
        trial.chips.do("press lr 0.8")
        pressed = pytest.approx((0.05, 0.0, 0.8), abs=0.05)
        trial.can.wait("lr with the force", lambda: trial.can.force_n("lr", mark) == pressed)
        trial.chips.do("lift")
        trial.chips.do("hold lm")
        trial.can.wait_for(State.ABSENT, ["lm"])
        run("sleep 2")
        trial.chips.do("clear")
        trial.recovered()
        trial.row.shown = trial.can.shown(mark)
        assert trial.robot.pid == pid
        assert Cause.BUS_STUCK in trial.can.causes(mark)["lm"]
    finally:
        run(
            f"systemctl stop footsense; mv {CONFIG}.before {CONFIG}\n"
            f"echo 0x71 > {_ADAPTER}/delete_device; systemctl start footsense --no-block"
        )


def test_foreign_switches(trial: Trial) -> None:
    """Another program switches the multiplexer 150 times (`i2cset`), with lr pressed."""
    pid, cursor = trial.robot.pid, trial.machine.journal_cursor
    trial.chips.do("press lr 0.8")
    pressed = pytest.approx((0.05, 0.0, 0.8), abs=0.05)
    trial.can.wait("lr with the force", lambda: trial.can.force_n("lr", trial.mark) == pressed)
    trial.machine.run("for n in $(seq 150); do i2cset -f -y 1 0x71 $((1 << n % 6)) || true; done")
    trial.chips.do("lift")
    trial.recovered()
    assert trial.robot.pid == pid
    forces = [(frame.leg, force) for frame in trial.can.since(trial.mark) if (force := frame.force)]
    of_others = [
        force
        for leg, force in forces
        if leg != "lr" and force.state is State.VALID and force.force_n[2] > 0.1
    ]
    assert of_others == []
    trial.row.shown = (
        f"{trial.can.shown(trial.mark)}; {len(trial.machine.journal(cursor))} lines in the journal"
    )
