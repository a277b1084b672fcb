"""Command `footsense install`: make a computer a robot's, or take it back."""

import errno
import os
import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import click

from footsense.cli.options import FOLDER
from footsense.cli.setup.installed_files import LIST, InstalledFiles
from footsense.cli.setup.robot_computer import ENVIRONMENT, Run, check_computer, findings, run_command
from footsense.config import Config, load_config
from footsense.config.contradictions import warnings
from footsense.errors import FootsenseError

_UNITS = "/etc/systemd/system"
_SERVICES = (
    "footsense",
    "footsense-exporter",
    "footsense-view",
    "footsense-ros2",
    "footsense-selfcal",
    "footsense-snapshot",
)
#: Where each file of the folder `deploy` is installed.
_TARGETS = {
    **{f"{name}.service": (f"{_UNITS}/{name}.service",) for name in _SERVICES},
    "footsense-device.conf": tuple(
        f"{_UNITS}/{device}.d/footsense.conf"
        for device in (r"dev-i2c\x2d1.device", "sys-subsystem-net-devices-can0.device")
    ),
    "footsense-sysusers.conf": ("/etc/sysusers.d/footsense.conf",),
    "footsense-modules.conf": ("/etc/modules-load.d/footsense.conf",),
    "99-footsense-i2c.rules": ("/etc/udev/rules.d/99-footsense-i2c.rules",),
    "80-can0.network": ("/etc/systemd/network/80-can0.network",),
    "79-can0-gs_usb.network": ("/etc/systemd/network/79-can0-gs_usb.network",),
}
#: Those that a robot needs by its configuration.
_SERIAL, _MUX_RESET = "footsense-serial.conf", "footsense-mux-reset.conf"
_DROP_INS = f"{_UNITS}/footsense.service.d"
#: Orders the service after the devices of its robot.
_DEVICES = """# The devices of /etc/footsense/footsense.yaml. Written by `footsense install`.
[Unit]
After={0}
Wants={0}
"""
_CONFIG = "/etc/footsense/footsense.yaml"
_NETWORKD, _WAIT_ONLINE = "systemd-networkd", "systemd-networkd-wait-online"
#: What to do about an error of the file system.
_REMEDIES = {
    errno.ENOSPC: "free some of the card (apt-get clean; journalctl --vacuum-size=50M)",
    errno.EROFS: "it is mounted read-only, as after an error of the card: dmesg says which",
    errno.EACCES: "run it as root",
}


class InstallStep(NamedTuple):
    """A step of an installation.

    Attributes:
        text: What it does, for a person.
        do: Does it.
    """

    text: str
    do: Callable[[], None]


@click.command()
@click.option(
    "--remove", is_flag=True, help="Take away what was installed; configuration and recordings stay."
)
@click.option("--dry-run", is_flag=True, help="Print the steps, and do none.")
@click.option("--root", type=FOLDER, default="/", help="Root directory of another system, such as an image.")
def install(root: Path, *, remove: bool, dry_run: bool) -> None:
    """Make this computer a robot's: user, units, udev rules, can0. Also after each upgrade.

    It may be repeated at any time, and goes on where another one was cut short.
    """  # noqa: DOC501 - click shows this text
    root = root.resolve()
    if root == Path("/") and os.geteuid() and not dry_run:
        raise FootsenseError(f"it writes to /etc: run it as root: sudo /{ENVIRONMENT}/bin/footsense install")
    os.umask(0o022)  # the user footsense reads what is written
    is_running = root == Path("/") and Path("/run/systemd/system").exists()
    for line in installed(root, run_command, is_running=is_running, remove=remove, dry_run=dry_run):
        click.echo(line)
    os.sync()  # a robot is switched off without warning


def installed(root: Path, run: Run, *, is_running: bool, remove: bool, dry_run: bool) -> Iterator[str]:
    """Install footsense in a system, or remove it.

    Args:
        root: Root directory of the system.
        run: Runs commands.
        is_running: Whether it is the running system, whose services hear of the changes.
        remove: Whether to remove.
        dry_run: Whether nothing is done.

    Yields:
        What is being done, and at the end what is next.

    Raises:
        FootsenseError: It cannot be a robot's, a file was edited by hand, or a step failed.
        ConfigError: The configuration of its robot is wrong.
    """
    files = InstalledFiles(root)
    if remove:
        files.check_unedited({})
        steps = _removal(root, files, run, is_running=is_running)
    else:
        check_computer(root)
        contents = _contents(root)
        files.check_unedited(contents)
        steps = _installation(root, files, contents, run, is_running=is_running)
    for step in steps:
        if step.text:
            yield step.text
        if not dry_run:
            try:
                step.do()
            except OSError as error:
                remedy = _REMEDIES.get(error.errno or 0, "")
                raise FootsenseError(
                    f"{error.filename}: {error.strerror}: {remedy}{'; ' if remedy else ''}then repeat this, which goes "
                    "on where it ended"
                ) from None
    yield "nothing to do" if not steps else "dry run: nothing was done" if dry_run else "done"
    if remove:
        kept = (_CONFIG, "/var/lib/footsense", f"/{ENVIRONMENT}")
        yield f"kept: {', '.join([path for path in kept if (root / path[1:]).exists()])}, the user footsense"
        return
    if is_running:
        yield from (f"warning: {finding}" for finding in findings(root))
    if (file := root / _CONFIG[1:]).exists():
        yield from (f"warning: {file}: {warning}" for warning in warnings(load_config(file)))
    yield from _next_steps(root, run, is_running=is_running)


def _contents(root: Path) -> dict[str, bytes]:
    """Return what has to be in the system, by path."""
    package = Path(__file__).parents[2]
    folder = package / "deploy" if (package / "deploy").exists() else package.parent / "deploy"
    names = dict(_TARGETS)
    generated: dict[str, bytes] = {}
    if (file := root / _CONFIG[1:]).exists():
        config = load_config(file)
        needed = {
            _SERIAL: config.serial is not None,
            _MUX_RESET: any(bus.mux.reset is not None for bus in config.buses),
        }
        names |= {name: (f"{_DROP_INS}/{name}",) for name, is_on in needed.items() if is_on}
        units = [_device_unit(path) for path in _device_paths(config)]
        limits = [f"{_UNITS}/{unit}.d/footsense.conf" for unit in units]
        names["footsense-device.conf"] = tuple(dict.fromkeys([*names["footsense-device.conf"], *limits]))
        if units:
            generated[f"{_DROP_INS}/footsense-devices.conf"] = _DEVICES.format(" ".join(units)).encode()
    return generated | {path: (folder / name).read_bytes() for name, paths in names.items() for path in paths}


def _device_paths(config: Config) -> list[str]:
    devices = [config.serial.device] if config.serial else [bus.device for bus in config.buses]
    if config.can.interface == "socketcan":
        devices.append(f"/sys/subsystem/net/devices/{config.can.channel}")
    return [device for device in devices if device.startswith("/")]


def _device_unit(path: str) -> str:
    """Return the unit of a device as `systemd-escape --path --suffix=device` does."""
    escaped = re.sub(r"[^A-Za-z0-9:_./]", lambda found: rf"\x{ord(found[0]):02x}", path.strip("/"))
    return f"{escaped.replace('/', '-')}.device"


def _installation(
    root: Path, files: InstalledFiles, contents: dict[str, bytes], run: Run, *, is_running: bool
) -> list[InstallStep]:
    """Return the steps that are left to do, the list of files before and after all others."""
    systemctl = _systemctl(root)
    enables_networkd = bool(run((*systemctl, "is-enabled", "--quiet", _NETWORKD)))
    files.enabled_networkd |= enables_networkd
    changed = files.differing(contents)
    outdated = [path for path in files.paths if path not in contents]
    final = files.list_text(contents, is_complete=True)
    if not (changed or outdated or enables_networkd or files.differing({LIST: final})):
        return []
    commands: list[tuple[str, ...]] = [("systemd-sysusers", f"--root={root}", "footsense.conf")]
    if files.enabled_networkd:
        # It would wait for a network that NetworkManager has, and hold up the boot for two minutes.
        commands += [(*systemctl, "enable", _NETWORKD), (*systemctl, "disable", _WAIT_ONLINE)]
    if is_running:
        commands += [
            ("systemctl", "daemon-reload"),
            ("udevadm", "control", "--reload"),
            ("modprobe", "i2c-dev"),
            ("udevadm", "trigger", "--subsystem-match=i2c-dev", "--subsystem-match=gpio"),
            ("systemctl", "reload-or-restart", _NETWORKD),
        ]
    return [
        InstallStep(
            f"write {LIST}", partial(files.write, LIST, files.list_text(contents, is_complete=False))
        ),
        *(InstallStep(f"write {path}", partial(files.write, path, contents[path])) for path in changed),
        *(InstallStep(f"remove {path}", partial(files.remove, path)) for path in outdated),
        *(_command_step(run, command) for command in commands),
        InstallStep("", partial(files.write, LIST, final)),
    ]


def _removal(root: Path, files: InstalledFiles, run: Run, *, is_running: bool) -> list[InstallStep]:
    """Return the steps that are left to do, the list of files last."""
    if not files.paths:
        return []
    systemctl, now = _systemctl(root), ("--now",) * is_running
    here = [path for path in files.paths if (root / path[1:]).exists()]
    services = [Path(path).name for path in here if path.endswith(".service")]
    commands = [(*systemctl, "disable", *now, *services)] * bool(services)
    if files.enabled_networkd:
        commands.append((*systemctl, "disable", *now, f"{_NETWORKD}.service", f"{_NETWORKD}.socket"))
    reloads: list[tuple[str, ...]] = [("systemctl", "daemon-reload"), ("udevadm", "control", "--reload")]
    return [
        *(_command_step(run, command) for command in commands),
        *(InstallStep(f"remove {path}", partial(files.remove, path)) for path in here),
        *(_command_step(run, command) for command in reloads * is_running),
        InstallStep(f"remove {LIST}", partial(files.remove, LIST)),
    ]


def _systemctl(root: Path) -> tuple[str, ...]:
    return ("systemctl",) if root == Path("/") else ("systemctl", f"--root={root}")


def _command_step(run: Run, command: tuple[str, ...]) -> InstallStep:
    def do() -> None:
        if failure := run(command):
            raise FootsenseError(f"{' '.join(command)}: {failure}; set it right, and repeat this")

    return InstallStep(" ".join(command), do)


def _next_steps(root: Path, run: Run, *, is_running: bool) -> Iterator[str]:
    if not (root / _CONFIG[1:]).exists():
        yield f"next: /{ENVIRONMENT}/bin/footsense init {_CONFIG}; then this once more, for its devices"
        yield f"next: systemctl enable --now {' '.join(_SERVICES[:3])}"
    elif is_running:
        active = [name for name in _SERVICES if not run(("systemctl", "is-active", "--quiet", name))]
        if active:
            yield f"next, with the robot at rest: systemctl restart {' '.join(active)}"
