"""Checks for settings that are valid each for itself but contradict each other."""

import math
from collections.abc import Iterable, Iterator, Mapping
from ipaddress import IPv4Address, IPv6Address, ip_address

from firmware_interface.wire_timing import can_bits_per_s
from footsense.config.boards import BOARDS
from footsense.config.schema import DEFAULT_PUBLISH_EVERY, Config
from footsense.config.sections import PCA9685_ALLCALL_ADDRESS, Bus, Leg, Scan
from footsense.strict_yaml import Problem

#: Largest share of the CAN bit rate for all frames of footsense; the rest is the robot's.
_MAX_CAN_LOAD_REL = 0.7
#: Supply of the bus, the voltage of a low line, and the current that a chip sinks at it.
_SUPPLY_V, _LOW_V, _SINK_MA = 3.3, 0.4, 3.0


def first_contradiction(config: Config) -> Problem | None:
    """Return the first contradiction between settings of a configuration; None if there is none."""
    return next(_contradictions(config), None)


def warnings(config: Config) -> tuple[str, ...]:
    """Return warnings about settings that are allowed but often a mistake, one text line each."""
    return tuple(str(problem) for problem in _warnings(config))


def pull_up_fault(bus: Bus) -> str | None:
    """Return an error message about the pull-up resistors of a bus; None if they are right or not configured.

    footsense connects all legs at once, so that their resistors are in parallel.

    Source: UM10204, table 10: a chip sinks 3 mA at 0.4 V.
    """
    if bus.pull_ups is None:
        return None
    together = len(bus.channels) or 1
    siemens = 1 / bus.pull_ups.upstream + together / bus.pull_ups.leg
    current_ma = (_SUPPLY_V - _LOW_V) * siemens * 1e3
    if current_ma <= _SINK_MA:
        return None
    left = _SINK_MA * 1e-3 / (_SUPPLY_V - _LOW_V) - 1 / bus.pull_ups.upstream
    remedy = f"at least {together / left:.0f} Ohm on each leg" if left > 0 else "larger ones upstream too"
    return (
        f"with {together} legs connected at once {1 / siemens:.0f} Ohm pull each line up, and a chip that pulls it "
        f"down has to sink {current_ma:.1f} mA, at most {_SINK_MA:g} are allowed; {remedy}"
    )


def _contradictions(config: Config) -> Iterator[Problem]:
    """Yield all contradictions between settings."""
    yield from _board_contradictions(config)
    yield from _bus_contradictions(config)
    for i, bus in enumerate(config.buses):
        yield from _bus_leg_contradictions(bus, f"buses[{i}].legs")
        yield from _address_contradictions(bus, f"buses[{i}]", config.board)
    yield from _timing_contradictions(config)
    yield from _can_contradictions(config)
    yield from _foot_contradictions(config)
    if config.metrics is not None and _parse_ip(address := config.metrics.address) is None:
        yield Problem("metrics.address", f"{address!r} is not an IP address; such as 127.0.0.1")


def _board_contradictions(config: Config) -> Iterator[Problem]:
    """Yield settings that belong to another board."""
    board, serial = config.board, config.serial
    if board != "mcu":
        if serial is not None:
            yield Problem("serial", f"is for board: mcu; the board {board} is read over I2C")
        if not config.buses:
            yield Problem("board", f"the board {board} is read over I2C: name its buses, with their legs")
        rates = BOARDS[board].rate_by_sps
        if config.rate_sps not in rates:
            allowed = ", ".join(map(str, sorted(rates)))
            yield Problem(
                "scan.rate_sps",
                f"{config.rate_sps} is no rate of the board {board}; use one of {allowed}",
            )
        return
    if serial is None:
        yield Problem("board", "mcu needs the line to the microcontroller: serial: {device: ...}")
        return
    if config.buses:
        yield Problem("buses", "the board mcu has no I2C bus; take buses away, or use another board")
    if config.scan != Scan():
        yield Problem("scan", "the microcontroller scans at serial.rate_hz; take scan away")
    if config.publish_every != DEFAULT_PUBLISH_EVERY:
        yield Problem(
            "publish_every", "every record of the microcontroller is published; take publish_every away"
        )
    legs = ((f"serial.legs[{n}]", leg, "") for n, leg in enumerate(serial.legs))
    yield from _repeated_value_problems(legs, "{} is named twice")


def _bus_contradictions(config: Config) -> Iterator[Problem]:
    """Yield contradictions of the I2C buses: repeated devices or legs, addresses, pull-ups."""
    buses = list(enumerate(config.buses))
    devices = ((f"buses[{i}].device", bus.device, f"buses[{i}]") for i, bus in buses)
    remedy = "give each its own, or join their legs under one bus"
    yield from _repeated_value_problems(devices, "{} is already the device of {}; " + remedy)
    legs = ((f"buses[{i}].legs.{leg}", leg, f"buses[{i}]") for i, bus in buses for leg in bus.legs)
    yield from _repeated_value_problems(
        legs, "{} is already a leg of {}; a leg has one foot, so name it once"
    )
    simulated = [
        {device.startswith("sim") for device in (bus.device, *bus.adapters.values())} for _, bus in buses
    ]
    if len(set().union(*simulated)) > 1:
        i = next(i for i, kinds in enumerate(simulated) if True in kinds)
        yield Problem(
            f"buses[{i}].device", "simulated and real buses cannot be mixed; use sim for all or none"
        )


def _bus_leg_contradictions(bus: Bus, path: str) -> Iterator[Problem]:
    """Yield contradictions of the legs of one bus: mux channels and adapters."""
    if bus.channels and bus.adapters:
        yield Problem(
            f"{path}.{next(iter(bus.adapters))}",
            "the multiplexer is driven by the kernel or by footsense, never by both: "
            "name an adapter for every leg, or a channel for every leg",
        )
    adapters = ((f"{path}.{leg}", device, f"that of {leg}") for leg, device in bus.adapters.items())
    devices = [(path, bus.device, "the bus itself"), *adapters]
    yield from _repeated_value_problems(devices, "{} is already {}; `i2cdetect -l` lists them")
    free = sorted(set(range(8)) - set(bus.channels.values()))
    channels = ((f"{path}.{leg}", channel, leg) for leg, channel in bus.channels.items())
    yield from _repeated_value_problems(
        channels, f"channel {{}} is already that of {{}}; free channels are {free}"
    )


def _address_contradictions(bus: Bus, path: str, board: str) -> Iterator[Problem]:
    """Yield devices with the I2C address of another device of the bus or of a leg's chips."""
    if bus.mux.address == PCA9685_ALLCALL_ADDRESS:
        for device in bus.other_devices:
            if "pca9685" in device.name.lower():
                yield Problem(
                    f"{path}.mux.address",
                    f"{device.name} answers at 0x70 too (ALLCALL): every channel switch would reach the servos; "
                    "strap the TCA9548A to 0x71 to 0x77",
                )
    owners = {bus.mux.address: "the multiplexer; change one of them"}
    for address, name in BOARDS[board].chip_name_by_address.items():
        owners[address] = f"the {name} of every leg; move it to another address or another bus"
    for k, device in enumerate(bus.other_devices):
        if owner := owners.get(device.address):
            message = f"{device.name} answers at {device.address:#04x}, as does {owner}"
            yield Problem(f"{path}.other_devices[{k}].address", message)
        owners.setdefault(device.address, f"{device.name}; change one of them, or name a device once")


def _timing_contradictions(config: Config) -> Iterator[Problem]:
    """Yield contradictions of rates and age limits."""
    # The oldest element is a whole scan old at sending, and a scan takes a tenth longer than its limit.
    shortest_ms = config.shortest_scan_ms
    if config.stale_after_ms < 1.25 * shortest_ms:
        pace = f"{config.rate_sps} S/s" if config.serial is None else f"{config.serial.rate_hz:g} scans/s"
        yield Problem(
            "max_age_ms",
            f"a scan takes {shortest_ms:g} ms and more at {pace}: "
            f"every force would be stale; use at least {2 * shortest_ms:g}",
        )


def _can_contradictions(config: Config) -> Iterator[Problem]:
    """Yield contradictions of the CAN settings, such as an overloaded bus."""
    can = config.can
    group = _parse_ip(can.channel)
    if can.interface == "udp_multicast" and not (isinstance(group, IPv4Address) and group.is_multicast):
        yield Problem(
            "can.channel",
            f"{can.channel} is no IPv4 multicast address, as udp_multicast needs one; use 239.74.163.2",
        )
    per_s = config.forces_hz
    bits_per_s = can_bits_per_s(len(config.legs), per_s, fd=can.fd)
    share = bits_per_s / (_MAX_CAN_LOAD_REL * can.bitrate)
    if can.interface == "socketcan" and share > 1.0:
        others_per_s = can_bits_per_s(len(config.legs), 0.0, fd=can.fd)
        forces_share = (bits_per_s - others_per_s) / (_MAX_CAN_LOAD_REL * can.bitrate - others_per_s)
        fewer = f"publish_every: {math.ceil(forces_share * config.publish_every)}"
        yield Problem(
            "can.bitrate",
            f"{len(config.legs)} legs at {per_s:.0f} forces/s take {bits_per_s * 1e-3:.0f} kbit/s, more than "
            f"{_MAX_CAN_LOAD_REL:.0%} of {can.bitrate * 1e-3:.0f} kbit/s; "
            f"use 1000000, or {fewer if config.serial is None else 'fewer records'}",
        )


def _foot_contradictions(config: Config) -> Iterator[Problem]:
    """Yield contradictions of the settings of legs and feet."""
    feet = ((f"feet.{leg}", foot, leg) for leg, foot in config.feet.items())
    yield from _repeated_value_problems(feet, "{} is already mounted on {}")
    sections: dict[str, Mapping[Leg, object]] = {
        "feet": config.feet,
        "stray_pf": config.stray_pf,
        "unloaded_pf": config.unloaded_pf,
    }
    for section, legs in sections.items():
        for leg in sorted(set(legs) - set(config.legs)):
            yield Problem(
                f"{section}.{leg}", f"no bus has the leg {leg}; the legs are {', '.join(config.legs)}"
            )
    if config.calibrations is None:
        return
    if not config.feet:
        yield Problem("calibrations", "no foot is named; name them under feet")
    if config.model is not None:
        remedy = "take model or calibrations away"
        yield Problem("model", f"each calibration brings the network that it was fitted on; {remedy}")
    for section in ("stray_pf", "unloaded_pf"):
        for leg in sorted(set(sections[section]) & set(config.feet)):
            yield Problem(
                f"{section}.{leg}", f"the calibration of {config.feet[leg]} has it; take this entry away"
            )


def _repeated_value_problems(
    entries: Iterable[tuple[str, int | str, str]], message: str
) -> Iterator[Problem]:
    """Yield a problem for every (path, value, owner) entry whose value occurred before.

    Args:
        entries: Path, value and owner of each.
        message: Text with places for the value and the owner of the earlier entry.
    """
    owner_of: dict[int | str, str] = {}
    for path, value, owner in entries:
        if value in owner_of:
            yield Problem(path, message.format(value, owner_of[value]))
        owner_of.setdefault(value, owner)


def _parse_ip(address: str) -> IPv4Address | IPv6Address | None:
    """Return an IP address; None for other text."""
    try:
        return ip_address(address)
    except ValueError:
        return None


def _warnings(config: Config) -> Iterator[Problem]:
    """Yield a warning for each setting that is allowed but often a mistake."""
    for i, bus in enumerate(config.buses):
        if bus.mux.address == PCA9685_ALLCALL_ADDRESS:
            yield Problem(
                f"buses[{i}].mux.address",
                "0x70 is also the ALLCALL address of PCA9685 servo boards; prefer 0x71",
            )
        if fault := pull_up_fault(bus):
            yield Problem(f"buses[{i}].pull_ups", fault)
    if config.metrics is not None and not ip_address(config.metrics.address).is_loopback:
        yield Problem("metrics.address", f"the network reads {config.metrics.address} without a password")
    serial = config.serial
    if serial is not None and serial.device.startswith("/dev/tty"):
        yield Problem(
            "serial.device",
            f"{serial.device} may be another device when it is plugged in again; "
            "prefer its name under /dev/serial/by-id",
        )
    devices = [serial.device] if serial is not None else [bus.device for bus in config.buses]
    if config.can.interface != "socketcan" and any(device.startswith("/dev/") for device in devices):
        limit = "process" if config.can.interface == "virtual" else "computer"
        yield Problem(
            "can.interface",
            f"{config.can.interface} never leaves the {limit}; the robot's controller needs socketcan",
        )
