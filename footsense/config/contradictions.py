"""Checks for settings that are valid each for itself but contradict each other."""

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from firmware_interface.chips import ad7147
from firmware_interface.wire_timing import can_bits_per_s
from footsense.acquisition.mcu_source import Serial
from footsense.acquisition.scan_plan import Scan, bus_overload
from footsense.config.schema import Config
from footsense.config.sections import PCA9685_ALLCALL_ADDRESS, Bus, Mux
from footsense.foot.type_folders import released_names, unknown_name_remedy
from footsense.strict_yaml import Problem
from footsense.wires.address import is_multicast

#: Largest share of the CAN bit rate for all frames of footsense; the rest is the robot's.
_MAX_CAN_LOAD_REL = 0.7

#: Whether a rule is broken, the path of the setting, and the message.
_Rule = tuple[bool, str, str]


def first_contradiction(config: Config) -> Problem | None:
    """Return the first contradiction between settings of a configuration; None if there is none."""
    return next((Problem(path, message) for broken, path, message in _rules(config) if broken), None)


def missing_folder(config: Config, parent: Path) -> Problem | None:
    """Return the first folder of a foot type or calibration that has to be there and is not; None if all are.

    Args:
        config: The configuration.
        parent: Folder of its file, in which relative paths are.
    """
    if "/" in config.foot_type and not (folder := parent / config.foot_type).is_dir():
        remedy = "`footsense lab build --foot` makes one"
        return Problem("foot_type", f"no foot type {config.foot_type}: {folder} is not a folder; {remedy}")
    for leg, foot in config.feet.items() if config.calibrations is not None else ():
        if (
            leg not in config.unloaded_pf
            and not (folder := parent / str(config.calibrations) / foot).is_dir()
        ):
            remedy = (
                "`footsense test-stand calibrate` makes one; until then give what it reads under unloaded_pf"
            )
            return Problem(f"feet.{leg}", f"{folder}: no such calibration; {remedy}")
    return None


def warnings(config: Config) -> tuple[str, ...]:
    """Return warnings about settings that are allowed but often a mistake, one text line each."""
    return tuple(f"{path}: {message}" for broken, path, message in _doubts(config) if broken)


def _rules(config: Config) -> Iterator[_Rule]:
    """Yield all rules between settings, whether each is broken, and what would be right."""
    if config.board == "mcu":
        yield from _mcu_rules(config, config.serial)
    else:
        yield from _i2c_rules(config)
    # The oldest element is a whole scan old at sending, and a scan takes a tenth longer than its limit.
    shortest_ms = config.shortest_scan_ms
    yield (
        config.effective_max_age_ms < 1.25 * shortest_ms,
        "max_age_ms",
        f"a scan takes {shortest_ms:g} ms and more: every force would be stale; use at least {2 * shortest_ms:g}",
    )
    yield from _can_rules(config)
    yield from _foot_rules(config)


def _mcu_rules(config: Config, serial: Serial | None) -> Iterator[_Rule]:
    yield serial is None, "board", "mcu needs the line to the microcontroller: serial: {device: ...}"
    yield bool(config.buses), "buses", "the board mcu has no I2C bus; take buses away, or use another board"
    yield config.scan != Scan(), "scan", "the microcontroller scans at serial.rate_hz; take scan away"
    yield (
        config.publish_every is not None,
        "publish_every",
        "every record of the microcontroller is published; take publish_every away",
    )
    legs = [(f"serial.legs[{n}]", leg, "") for n, leg in enumerate(serial.legs if serial else ())]
    yield from _repeated(legs, "{} is named twice")


def _i2c_rules(config: Config) -> Iterator[_Rule]:
    board = config.board
    yield config.serial is not None, "serial", f"is for board: mcu; the board {board} is read over I2C"
    yield not config.buses, "board", f"the board {board} is read over I2C: name its buses, with their legs"
    buses = [(f"buses[{i}]", bus) for i, bus in enumerate(config.buses)]
    remedy = "give each its own, or join their legs under one bus"
    devices = [(f"{path}.device", bus.device, path) for path, bus in buses]
    yield from _repeated(devices, "{} is already the device of {}; " + remedy)
    legs = [(f"{path}.legs.{leg}", leg, path) for path, bus in buses for leg in bus.channels]
    yield from _repeated(legs, "{} is already a leg of {}; a leg has one foot, so name it once")
    simulated = {bus.device.startswith("sim"): path for path, bus in buses}
    mixed = "simulated and real buses cannot be mixed; use sim for all or none"
    yield len(simulated) > 1, f"{simulated.get(True)}.device", mixed
    for path, bus in buses:
        is_other = bool(bus.addresses) and board != "ad7147"
        fixed = f"the converters of board {board} have one address; name channels of a multiplexer under legs"
        yield is_other, f"{path}.addresses", fixed
        yield from _bus_leg_rules(bus, path)
    one_rate = "the board ad7147 converts at one rate; take scan away"
    yield board == "ad7147" and config.scan != Scan(), "scan", one_rate


def _bus_leg_rules(bus: Bus, path: str) -> Iterator[_Rule]:
    which = (
        "name its legs with their channels of the multiplexer, under leg the one that is directly on it, or with board "
        "ad7147 their addresses under addresses"
    )
    yield bool(bus.legs) + (bus.leg is not None) + bool(bus.addresses) != 1, f"{path}.legs", which
    directly = (
        "its legs are directly on the adapter; take mux away, or name a channel for every leg under legs"
    )
    yield not bus.legs and bus.mux != Mux(), f"{path}.mux", directly
    free_addresses = ", ".join(
        f"{each:#x}" for each in ad7147.ADDRESSES if each not in bus.addresses.values()
    )
    addresses = [(f"{path}.addresses.{leg}", f"{address:#x}", leg) for leg, address in bus.addresses.items()]
    yield from _repeated(addresses, f"address {{}} is already that of {{}}; free are {free_addresses}")
    free = sorted(set(range(8)) - set(bus.legs.values()))
    channels = [(f"{path}.legs.{leg}", channel, leg) for leg, channel in bus.legs.items()]
    yield from _repeated(channels, f"channel {{}} is already that of {{}}; free channels are {free}")


def _can_rules(config: Config) -> Iterator[_Rule]:
    can, n_legs = config.can, len(config.legs)
    is_wrong_group = can.interface == "udp_multicast" and not is_multicast(can.channel)
    yield is_wrong_group, "can.channel", f"{can.channel} is no IPv4 multicast address; use 239.74.163.2"
    allowed_per_s, bits_per_s = _MAX_CAN_LOAD_REL * can.bitrate, can_bits_per_s(n_legs, config.forces_hz)
    others_per_s = can_bits_per_s(n_legs, 0.0)
    times_too_many = (bits_per_s - others_per_s) / max(allowed_per_s - others_per_s, 1.0)
    fewer = f"publish_every: {math.ceil(times_too_many * config.effective_publish_every)}"
    too_many = (
        f"{n_legs} legs at {config.forces_hz:.0f} forces/s take {bits_per_s * 1e-3:.0f} kbit/s, more than "
        f"{_MAX_CAN_LOAD_REL:.0%} of {can.bitrate * 1e-3:.0f} kbit/s; "
        f"use 1000000, or {fewer if config.serial is None else 'fewer records'}"
    )
    yield can.interface == "socketcan" and bits_per_s > allowed_per_s, "can.bitrate", too_many


def _foot_rules(config: Config) -> Iterator[_Rule]:
    foot_type, feet = config.foot_type, config.feet
    # With a network of its own the name may be of any foot type.
    unknown = config.model is None and "/" not in foot_type and foot_type not in released_names()
    yield unknown, "foot_type", f"no foot type {foot_type}: {unknown_name_remedy(foot_type)}"
    yield from _repeated(
        [(f"feet.{leg}", foot, leg) for leg, foot in feet.items()], "{} is already mounted on {}"
    )
    sections: dict[str, Mapping[Any, object]] = {
        "stray_pf": config.stray_pf,
        "unloaded_pf": config.unloaded_pf,
    }
    is_calibrated = config.calibrations is not None
    for section, legs in {"feet": feet, **sections}.items():
        for leg in sorted(legs):
            no_leg = f"no bus has the leg {leg}; the legs are {', '.join(config.legs)}"
            yield leg not in config.legs, f"{section}.{leg}", no_leg
    yield is_calibrated and not feet, "calibrations", "no foot is named; name them under feet"
    own_network = "each calibration brings the network that it was fitted on; take model or calibrations away"
    yield is_calibrated and config.model is not None, "model", own_network


def _repeated(entries: Iterable[tuple[str, int | str, str]], message: str) -> Iterator[_Rule]:
    """Yield for every (path, value, owner) whether its value occurred before.

    Args:
        entries: Path, value and owner of each.
        message: Text with places for the value and the owner of the earlier entry.
    """
    owner_of: dict[int | str, str] = {}
    for path, value, owner in entries:
        yield value in owner_of, path, message.format(value, owner_of.setdefault(value, owner))


def _bus_overload(config: Config, bus: Bus) -> str | None:
    """Return that a bus does not carry the configured rate even if its host costs nothing, in words; else None."""
    plan = config.scan_plan.on_bus(bus.mux_address)
    return bus_overload(plan, plan.lower_bounds(len(bus.channels), bus.rate_hz, host_cost_ns=0.0))


def _doubts(config: Config) -> Iterator[_Rule]:
    """Yield rules about what is allowed but often a mistake."""
    for i, bus in enumerate(config.buses):
        is_allcall = bus.mux.address == PCA9685_ALLCALL_ADDRESS
        allcall = "0x70 is also the ALLCALL address of PCA9685 servo boards; prefer 0x71"
        yield is_allcall, f"buses[{i}].mux.address", allcall
        overload = _bus_overload(config, bus)
        yield overload is not None, f"buses[{i}]", f"{bus.device} {overload}"
    address = config.metrics.address
    is_public = address not in ("127.0.0.1", "::1", "localhost")
    yield is_public, "metrics.address", f"the network reads {address} without a password"
    devices = [config.serial.device] if config.serial else [bus.device for bus in config.buses]
    renamed = "may be another device when it is plugged in again; prefer its name under /dev/serial/by-id"
    yield devices[0].startswith("/dev/tty"), "serial.device", f"{devices[0]} {renamed}"
    interface = config.can.interface
    stays = interface != "socketcan" and any(device.startswith("/dev/") for device in devices)
    limit = "process" if interface == "virtual" else "computer, and footsense.service may not use it"
    yield (
        stays,
        "can.interface",
        f"{interface} never leaves the {limit}; the robot's controller needs socketcan",
    )
