"""The machine as a robot, deployed as deploy/README.md says, and what a trial does with it."""

import re
from dataclasses import dataclass, field
from itertools import groupby

import pytest

from firmware_interface.can.codes import State
from tests.kernel import deploy_page
from tests.kernel.can_stream import LEGS
from tests.kernel.machine import Machine
from tests.kernel.ports import GuestError

CONFIG = "/etc/footsense/footsense.yaml"
UNIT = "footsense"
#: Legs on /dev/i2c-1 and on /dev/i2c-3.
LEFT, RIGHT = ("lf", "lm", "lr"), ("rf", "rm", "rr")
#: How long a command that ends by Ctrl-C is watched [s].
_WATCHED_S = 2
_ENDED_BY_TIMEOUT = 124
#: Where the commands of deploy/README.md are executed.
FOLDER = "cd /root/footsense/deploy\n"


@dataclass
class Row:
    """A row of the table of trials.

    Attributes:
        did: What was done.
        shown: What CAN showed.
        recovered_s: Time until all legs were valid again [s]; None where nothing had to recover.
        passed: Whether the trial passed.
    """

    did: str
    shown: str = ""
    recovered_s: float | None = None
    passed: bool = False


@dataclass
class Robot:
    """The deployed robot.

    Attributes:
        machine: The machine.
        outputs: What each command of deploy/README.md printed each time, by the command without its comment.
    """

    machine: Machine
    outputs: dict[str, list[str]] = field(default_factory=dict)

    def execute_section(self, number: int) -> None:
        """Execute the commands of a section of deploy/README.md, in the folder `deploy` of the checkout.

        Endless ones that follow each other run side by side, for some seconds.

        Raises:
            GuestError: One failed.
        """
        shell = self.machine.shell
        for are_endless, group in groupby(deploy_page.section(number), lambda command: command.is_endless):
            if are_endless:
                watched = f"{FOLDER}timeout --signal=INT {_WATCHED_S} "
                started = [(command, shell.start(watched + command.text)) for command in group]
                for command, asked in started:
                    code, output = shell.wait(asked)
                    self._note(command, 0 if code == _ENDED_BY_TIMEOUT else code, output)
            else:
                for command in group:
                    self._note(command, *shell.wait(shell.start(FOLDER + command.text)))

    def _note(self, command: deploy_page.Command, code: int, output: str) -> None:
        """Keep what a command of the page printed.

        Raises:
            GuestError: It failed.
        """
        if code:
            raise GuestError(f"deploy/README.md: {command.text}: exit {code}\n{output}")
        self.outputs.setdefault(command.text.partition("#")[0].strip(), []).append(output)

    def deploy(self) -> None:
        """Execute sections 2, unless it has been, to 5 of deploy/README.md."""
        if not self.outputs:
            self.execute_section(2)
        self.execute_section(3)
        self.execute_section(4)
        self.execute_section(5)

    def output_of(self, start: str) -> str:
        """Return what the command of deploy/README.md printed that starts so.

        Raises:
            GuestError: The page has no such command.
        """
        found = [outputs[-1] for command, outputs in self.outputs.items() if command.startswith(start)]
        if not found:
            raise GuestError(f"deploy/README.md has no command {start!r}")
        return found[0]

    @property
    def pid(self) -> int:
        """Process id of the service; 0 for none."""
        return int(self.machine.run(f"systemctl show -P MainPID {UNIT}"))

    @property
    def restarts(self) -> int:
        """How often systemd has restarted the service since its last `systemctl start`."""
        return int(self.machine.run(f"systemctl show -P NRestarts {UNIT}"))

    def started_within_s(self) -> float:
        """Start the service, and return how long `systemctl start` took, on the machine's clock [s]."""
        clock = "cut -d' ' -f1 /proc/uptime"
        began, ended = self.machine.run(f"{clock}; systemctl start {UNIT} >/dev/null 2>&1; {clock}").split()
        return float(ended) - float(began)

    def configure(self, *edits: str) -> None:
        """Restart the service after edits of its configuration by `sed`."""
        for edit in edits:
            self.machine.run(f"sed -i '{edit}' {CONFIG}")
        self.machine.run(f"systemctl restart {UNIT}")

    def repair(self) -> None:
        """Make everything whole, whatever a trial has broken, and wait until all legs are valid.

        Raises:
            GuestError: They do not become valid.
        """
        self.machine.chips.do("clear")
        self.machine.chips.do("lift")
        self.machine.run(
            "echo 3 > /sys/module/feet_adapter/parameters/plugged\n"
            "tc qdisc del dev can0 root 2>/dev/null\n"
            "ip link show can0 >/dev/null 2>&1 || ip link add can0 type vcan\n"
            f"ip link set can0 up\nsystemctl start {UNIT} --no-block"
        )
        try:
            self.machine.can.wait_for(State.VALID, bound_s=20)
        except GuestError:
            self.machine.run(f"systemctl restart {UNIT}")
            self.machine.can.wait_for(State.VALID)


class Trial:
    """A trial under way: what it does, and what comes of it.

    Args:
        robot: The robot.
        did: What is done, for the table.
    """

    def __init__(self, robot: Robot, did: str) -> None:
        self.robot = robot
        self.machine = robot.machine
        self.can = robot.machine.can
        self.chips = robot.machine.chips
        self.mark = self.can.mark
        self.row = Row(did)

    def press(self, leg: str) -> None:
        """Press a foot with (0.05, 0, 0.8) N, and wait until its force is that.

        Raises:
            GuestError: It does not become that.
        """
        self.chips.do(f"press {leg} 0.8")
        pressed = pytest.approx((0.05, 0.0, 0.8), abs=0.05)
        self.can.wait(f"{leg} with the force", lambda: self.can.force_n(leg, self.mark) == pressed)

    def recovered(self, *legs: str) -> None:
        """Wait until legs, or all, are valid, and note the time since the last command ended.

        Raises:
            GuestError: They do not become valid.
        """
        start_s = max(self.chips.ended_s, self.machine.shell.ended_s)
        self.row.recovered_s = max(self.can.wait_for(State.VALID, legs or LEGS.values()) - start_s, 0.0)

    def end(self, *, passed: bool) -> None:
        """Complete the row."""
        self.row.shown = self.row.shown or self.can.shown(self.mark)
        self.row.passed = passed


def matching(lines: list[str], pattern: str) -> list[str]:
    """Return the lines that contain a pattern."""
    return [line for line in lines if re.search(pattern, line)]
