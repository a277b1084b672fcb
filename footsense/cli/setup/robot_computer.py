"""The system that `footsense install` sets up: whether it can be a robot's, and what its adapters lack."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from footsense.can.channel import can_interfaces
from footsense.errors import FootsenseError

#: Runs a command and returns why it failed; an empty text if it did not.
Run = Callable[[tuple[str, ...]], str]

#: Environment whose program the units start.
ENVIRONMENT = "opt/footsense"
_PAGE = "docs/raspberry-pi.md"
#: Fifth byte of a program's file, for 32 bit. Source: System V ABI, ELF header, EI_CLASS.
_ELF_32 = 1
#: Drivers of CAN adapters without one-shot mode.
#: Source: Linux 6.1, drivers/net/can/spi/mcp251x.c and mcp251xfd/mcp251xfd-core.c, ctrlmode_supported.
_WITHOUT_ONE_SHOT = ("mcp251x", "mcp251xfd")


def run_command(command: tuple[str, ...]) -> str:
    """Run a command; return the last line of what it said if it failed, and an empty text if not."""
    try:
        done = subprocess.run(  # noqa: S603 - words of this package
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
    except FileNotFoundError:
        return "there is no such program"
    lines = done.stdout.strip().splitlines() or [f"exit {done.returncode}"]
    return lines[-1] if done.returncode else ""


def check_computer(root: Path) -> None:
    """Check that a system can be set up as a robot's.

    Args:
        root: Its root directory.

    Raises:
        FootsenseError: It has 32 bits, no systemd, or no footsense that its units could start.
    """
    shell = root / "bin/sh"
    if shell.exists() and shell.read_bytes()[4:5] == bytes([_ELF_32]):
        raise FootsenseError(
            f"{root} is a system of 32 bit, for which not all packages of footsense are made: take the 64 bit image "
            f"({_PAGE}, section 1)"
        )
    if not any((root / path).exists() for path in ("usr/bin/systemctl", "bin/systemctl")):
        raise FootsenseError(f"{root} has no systemd, which starts the services: take Debian 12 or 13")
    program = root / ENVIRONMENT / "bin/footsense"
    if not program.exists():
        raise FootsenseError(
            f"{program}: not there, and the services start it: install footsense in an environment of that name "
            f"({_PAGE}, section 3)"
        )
    if root == Path("/") and Path(sys.prefix) != root / ENVIRONMENT:
        raise FootsenseError(
            f"this is the footsense of {sys.prefix}, and the services start another: run {program} install"
        )


def findings(root: Path) -> Iterator[str]:
    """Yield what a running system lacks of the adapters that a robot needs, with the remedy.

    Args:
        root: Its root directory.
    """
    if not [*(root / "dev").glob("i2c-*")]:
        yield f"no I2C adapter: dtparam=i2c_arm=on in /boot/firmware/config.txt, and reboot ({_PAGE}, section 2)"
    networks = root / "sys/class/net"
    interfaces = can_interfaces(networks)
    silent = [
        device.name
        for device in sorted((root / "sys/bus/spi/devices").glob("*"))
        if "mcp25" in (device / "modalias").read_text() and not (device / "net").exists()
    ]
    if silent:
        yield (
            f"{silent[0]}: the CAN controller of the overlay does not answer: plug in its HAT, and take oscillator and "
            f"interrupt in /boot/firmware/config.txt from its manual ({_PAGE}, section 2)"
        )
    elif not interfaces:
        yield (
            "no CAN interface: plug in the adapter; a HAT needs the line dtoverlay=... of its manual in "
            f"/boot/firmware/config.txt, and a reboot ({_PAGE}, section 2)"
        )
    elif "can0" not in interfaces:
        yield f"no can0: {interfaces[0]} has no settings yet; copy 80-can0.network for it, and name it in can.channel"
    driver = Path(os.path.realpath(networks / "can0/device/driver")).name
    for file in sorted((root / "etc/systemd/network").glob("*can0*.network.d/*.conf")):
        if driver in _WITHOUT_ONE_SHOT and "OneShot=yes" in file.read_text().splitlines():
            yield f"{file}: can0 ({driver}) has no one-shot mode and stays down with it: remove the file"
