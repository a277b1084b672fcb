"""Text of a robot's file: what was found on its buses, with comments for the person who edits it."""

import textwrap
from collections.abc import Collection, Mapping
from pathlib import Path

from msgspec.structs import replace

from footsense.config import Config
from footsense.daemon.setup.probe import ProbeResult
from footsense.errors import ConfigError
from footsense.foot.type_folders import released_names

_BOARD_PARTS = {
    "ad7147": "an AD7147 in every foot",
    "fdc1004": "an FDC1004 and an ADG715 in every foot",
    "mcu": "a microcontroller scans the feet",
}
_LEG_WORDS = {
    "lf": "left front",
    "lm": "left middle",
    "lr": "left rear",
    "rf": "right front",
    "rm": "right middle",
    "rr": "right rear",
    "l4": "left, fourth",
    "r4": "right, fourth",
}
_CAN_WORDS = {
    "socketcan": "a CAN device of Linux",
    "udp_multicast": "programs on this computer alone. On a robot: interface: socketcan, channel: can0",
    "virtual": "within the process alone",
}
#: Column of the comments behind values.
_COMMENT_COLUMN = 29


def robot_file(config: Config, found: ProbeResult, names: Mapping[str, str], *, hang_free: bool) -> str:
    """Return the whole text of a robot's file.

    Args:
        config: The robot that was found.
        found: What a probe says of it.
        names: What the adapters call themselves, by device.
        hang_free: Whether the feet hung free in the probe: their readings are then what a tare is compared with.
    """
    can = config.can
    is_real = any(device.startswith("/dev/") for device in _devices(config))
    lines = [
        "# The robot, as `footsense init` found it. Change what differs, then `footsense check-config` this file.",
        "# A key that is left out has its default; deploy/footsense.yaml explains every key.",
        "",
        *_feet_part(config, names),
        "can:",
        _commented(f"  interface: {can.interface}", _CAN_WORDS[can.interface]),
        f"  channel: {can.channel}",
    ]
    if can.interface == "socketcan":
        lines.append(_commented(f"  bitrate: {can.bitrate}", "as systemd-networkd or `ip link` sets it"))
    if can.commands:
        lines.append(_commented("  commands: true", "`footsense tare`, by any program on this computer"))
    lines += [
        "",
        f"# Type of all feet: {', '.join(released_names())}; or, with a slash, a folder of your own.",
        f"foot_type: {config.foot_type}",
        "",
        "# Which foot is on which leg, and the folder of their calibrations (`footsense test-stand calibrate`).",
        f"# feet: {{{config.legs[0]}: foot-0001}}",
        "# calibrations: feet",
        "",
    ]
    if is_real:
        lines += _unloaded_part(found, hang_free=hang_free)
        lines.append(
            _commented("realtime: {priority: 40}", "SCHED_FIFO for the loop; take it away to do without")
        )
    return "\n".join(lines).rstrip() + "\n"


def found_part(config: Config, found: ProbeResult) -> str:
    """Return the part of a robot's file that a probe knows: legs that answer, and readings of feet that hang free."""
    header = "# Buses and feet, as `footsense probe` found them: a part of a robot's file."
    answering = [leg.leg for leg in found.legs if leg.scans is not None]
    config = _with_legs_alone(config, answering)
    return (
        "\n".join([header, "", *_feet_part(config, {}), *_unloaded_part(found, hang_free=True)]).rstrip()
        + "\n"
    )


def _with_legs_alone(config: Config, legs: Collection[str]) -> Config:
    """Return the configuration without other legs, and without the buses that then have none."""
    if config.serial is not None:
        kept = tuple(leg for leg in config.serial.legs if leg in legs)
        return replace(config, serial=replace(config.serial, legs=kept))
    buses = [
        replace(
            bus,
            legs={leg: channel for leg, channel in bus.legs.items() if leg in legs},
            addresses={leg: address for leg, address in bus.addresses.items() if leg in legs},
        )
        for bus in config.buses
        if set(bus.channels) & {*legs}
    ]
    return replace(config, buses=tuple(buses))


def unloaded_yaml(found: ProbeResult) -> str:
    """Return the readings of all fault-free feet as YAML for `unloaded_pf`; empty without any."""
    readings = [(leg.leg, leg.unloaded_pf) for leg in found.legs]
    lines = [f"  {leg}: [{', '.join(f'{pf:.3f}' for pf in values)}]" for leg, values in readings if values]
    folded = [textwrap.fill(line, 79, subsequent_indent=" " * 7) for line in lines]
    return "\n".join(["unloaded_pf:", *folded]) if folded else ""


def check_is_new(path: Path) -> None:
    """Raise an error if a file exists: none is overwritten.

    Raises:
        ConfigError: It exists.
    """
    if path.exists() or path.is_symlink():
        raise ConfigError(f"{path}: exists and is not overwritten; name another file, or remove it")


def _devices(config: Config) -> list[str]:
    return [config.serial.device] if config.serial else [bus.device for bus in config.buses]


def _commented(line: str, comment: str) -> str:
    return f"{line:<{_COMMENT_COLUMN - 1}} # {comment}"


def _feet_part(config: Config, names: Mapping[str, str]) -> list[str]:
    lines = [_commented(f"board: {config.board}", _BOARD_PARTS[config.board]), ""]
    if config.serial is not None:
        legs = ", ".join(config.serial.legs)
        return [*lines, "serial:", f"  device: {config.serial.device}", f"  legs: [{legs}]", ""]
    lines.append("buses:")
    for bus in config.buses:
        what = "simulated" if bus.device.startswith("sim") else names.get(bus.device, "")
        device = f"  - device: {bus.device}"
        lines.append(_commented(device, what) if what else device)
        if bus.leg is not None:
            lines.append(_commented(f"    leg: {bus.leg}", "the only one, directly on the adapter"))
            continue
        if bus.addresses:
            lines.append(_commented("    addresses:", "leg: address by the straps of its AD7147"))
            lines += [
                _commented(f"      {leg}: {address:#04x}", _LEG_WORDS[leg])
                for leg, address in bus.addresses.items()
            ]
            continue
        lines += ["    mux:", f"      address: {bus.mux.address:#04x}"]
        if bus.mux.reset is not None:
            lines.append(f"      reset: {{device: {bus.mux.reset.device}, line: {bus.mux.reset.line}}}")
        elif bus.device.startswith("/dev/"):
            lines += [
                "      # The GPIO line of its RESET pin, which alone frees the bus of a leg that holds it: wire one.",
                "      # reset: {device: /dev/gpiochip0, line: 17}",
            ]
        lines += [
            _commented("    legs:", "leg: channel of the multiplexer"),
            *(
                _commented(f"      {leg}: {channel}", _LEG_WORDS[leg])
                for leg, channel in bus.channels.items()
            ),
        ]
    return [*lines, ""]


def _unloaded_part(found: ProbeResult, *, hang_free: bool) -> list[str]:
    """Return the readings of the feet, as comments if the feet may have been loaded."""
    lines = unloaded_yaml(found).splitlines()
    if not lines:
        return []
    told = "# Capacitance of the free feet, pF: a foot that reads otherwise when it is tared is refused as loaded."
    if hang_free:
        return [told, *lines, ""]
    unsure = "# What the feet read just now; if they hung free, take these # away."
    return [told, unsure, *(f"# {line}" for line in lines), ""]
