"""Trials of board `fdc1004`, six legs behind a multiplexer on /dev/i2c-1: one that fails, and others that switch it."""

from collections.abc import Iterator

import pytest

from firmware_interface.can.codes import Cause, State
from footsense.frames import LEGS
from tests.kernel.robot import CONFIG, FOLDER, Robot, Trial

_PLUGGED = "/sys/module/feet_adapter/parameters/plugged"
_ADAPTER = "/sys/bus/i2c/devices/i2c-1"


@pytest.fixture(scope="module", autouse=True)
def _board(deployed: Robot) -> Iterator[None]:
    """Configure the board; at its lowest rate, which takes the host least time."""
    run = deployed.machine.run
    run(
        f"{FOLDER}cp {CONFIG} {CONFIG}.ad7147; cp footsense-fdc1004.yaml {CONFIG}\n"
        f"sed -i 's/^  rate_sps: 400 .*/  rate_sps: 100/' {CONFIG}; systemctl restart footsense --no-block"
    )
    yield
    run(f"mv {CONFIG}.ad7147 {CONFIG}; systemctl restart footsense --no-block")


@pytest.mark.parametrize("error", ["ENXIO", "SILENT"])
def test_every_transfer_fails(trial: Trial, error: str) -> None:
    """Every transfer to the multiplexer of board `fdc1004` ends with {error} until all legs are absent."""
    pid = trial.robot.pid
    trial.chips.do(f"fail mux {error}")
    trial.can.wait_for(State.ABSENT)
    trial.chips.do("clear")
    trial.recovered()
    assert trial.robot.pid == pid


def test_held_line_with_reset(trial: Trial) -> None:
    """A leg of board `fdc1004`, lm, holds SDA; RESET of the multiplexer on a GPIO."""
    run = trial.machine.run
    run(
        "mkdir -p /etc/systemd/system/footsense.service.d\n"
        "printf '[Service]\\nSupplementaryGroups=i2c gpio\\nDeviceAllow=char-gpiochip rw\\n'"
        " > /etc/systemd/system/footsense.service.d/reset.conf; systemctl daemon-reload\n"
        f"cp {CONFIG} {CONFIG}.before"
    )
    try:
        trial.robot.configure("s/# reset: .*/reset: {device: \\/dev\\/gpiochip0, line: 0}/")
        trial.can.wait_for(State.VALID)
        mark, (_, before) = trial.can.mark, trial.chips.counts
        trial.chips.do("hold lm mux")
        trial.can.wait_for(State.ABSENT, ["lm"])
        trial.can.wait_for(State.VALID, set(LEGS) - {"lm"})
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


def test_the_kernel_has_the_multiplexer(trial: Trial) -> None:
    """Multiplexer driven by the kernel (i2c-mux-pca954x), lr pressed, then lm holds SDA for 2 s."""
    run = trial.machine.run
    # A fresh adapter: a timeout that footsense has set outlives it.
    run(
        f"systemctl stop footsense; cp {CONFIG} {CONFIG}.before\n"
        f"echo 2 > {_PLUGGED}; until [ ! -e {_ADAPTER} ]; do sleep 0.1; done; echo 3 > {_PLUGGED}\n"
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
        trial.press("lr")
        trial.chips.do("lift")
        trial.chips.do("hold lm mux")
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
    trial.press("lr")
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
