"""Settings that are each right and together wrong: the path in the file, and what would be right."""

from collections.abc import Iterator, Mapping
from ipaddress import IPv4Address, ip_address

from footsense.config.boards import BOARDS
from footsense.config.schema import PCA9685_ALLCALL, Bus, Config, Scan
from footsense.strict_yaml import Problem

__all__ = ["first_contradiction"]

#: `Force` and `Quality`.
_FRAMES_PER_LEG = 2
#: Eight bytes under an 11-bit id with every stuff bit that can be, and the pause behind it.
_LONGEST_FRAME_BITS = 135
#: Share of the bus that forces may take; the rest is the robot's.
_CAN_SHARE = 0.7


def first_contradiction(config: Config) -> Problem | None:
    """Return the first contradiction of a configuration, None if there is none."""
    return next(_contradictions(config), None)


def _contradictions(config: Config) -> Iterator[Problem]:
    yield from _mcu(config)
    yield from _rate(config)
    yield from _between_buses(config)
    for i, bus in enumerate(config.buses):
        yield from _channels(bus, i)
        # What each leg occupies while its channel is connected to the trunk.
        yield from _addresses(bus, i, BOARDS[config.board].leg_devices)
    # The oldest element is a whole scan old when the forces go out, and a scan takes a tenth longer than its limit.
    scans = "a scan takes" if config.average_scans == 1 else f"{config.average_scans} scans take"
    shortest_ms = config.shortest_scan_ms
    if config.stale_after_ms < (config.average_scans + 0.25) * shortest_ms:
        pace = f"{config.rate_sps} S/s" if config.serial is None else f"{config.serial.rate_hz:g} scans/s"
        yield Problem(
            ("max_age_ms",),
            f"{scans} {shortest_ms * config.average_scans:g} ms and more at {pace}: "
            f"every force would be stale; use at least {(1 + config.average_scans) * shortest_ms:g}",
        )
    if config.publish == "element" and config.average_scans > 1:
        yield Problem(
            ("average_scans",),
            "is of use with publish: frame only; a prediction weighs old readings by itself",
        )
    if config.can.interface == "udp_multicast" and not _is_multicast(config.can.channel):
        yield Problem(
            ("can", "channel"),
            f"{config.can.channel} is no IPv4 multicast address, as udp_multicast needs one; use 239.74.163.2",
        )
    yield from _can_load(config)
    yield from _feet(config)
    yield from _calibrations(config)
    if config.metrics is not None:
        yield from _metrics(config.metrics.address)


def _mcu(config: Config) -> Iterator[Problem]:
    """Yield what does not go with the board that scans by itself, or with the others."""
    if config.board != "mcu":
        if config.serial is not None:
            yield Problem(("serial",), f"is for board: mcu; the board {config.board} is read over I2C")
        if not config.buses:
            yield Problem(
                ("board",), f"the board {config.board} is read over I2C: name its buses, with their legs"
            )
        return
    if config.serial is None:
        yield Problem(("board",), "mcu needs the line to the microcontroller: serial: {device: ...}")
    if config.buses:
        yield Problem(
            ("buses",), "the board mcu has no I2C bus of ours; take buses away, or use another board"
        )
    if config.scan != Scan():
        yield Problem(("scan",), "the microcontroller scans by itself, at serial.rate_hz; take scan away")
    if config.publish == "element":
        yield Problem(("publish",), "the microcontroller sends whole scans; use publish: frame")
    legs = config.serial.legs if config.serial is not None else ()
    for n, leg in enumerate(legs):
        if leg in legs[:n]:
            yield Problem(("serial", "legs", n), f"{leg} is named twice")


def _rate(config: Config) -> Iterator[Problem]:
    if config.board in BOARDS and config.rate_sps not in BOARDS[config.board].rates:
        rates = ", ".join(map(str, sorted(BOARDS[config.board].rates)))
        yield Problem(
            ("scan", "rate_sps"),
            f"{config.rate_sps} is no rate of the board {config.board}; use one of {rates}",
        )


def _is_multicast(channel: str) -> bool:
    try:
        return IPv4Address(channel).is_multicast
    except ValueError:
        return False


def _between_buses(config: Config) -> Iterator[Problem]:
    device_of: dict[str, int] = {}
    bus_of: dict[str, int] = {}
    for i, bus in enumerate(config.buses):
        if bus.device in device_of:
            other = f"buses[{device_of[bus.device]}]"
            remedy = "give each its own, or join their legs under one bus"
            yield Problem(("buses", i, "device"), f"{bus.device} is already the device of {other}; {remedy}")
        device_of[bus.device] = i
        for leg in bus.legs:
            if leg in bus_of:
                yield Problem(
                    ("buses", i, "legs", leg),
                    f"{leg} is already a leg of buses[{bus_of[leg]}]; a leg has one foot, so name it once",
                )
            bus_of[leg] = i
    simulated = [
        all(device.startswith("sim") for device in (bus.device, *bus.adapters.values()))
        for bus in config.buses
    ]
    real = [
        all(not device.startswith("sim") for device in (bus.device, *bus.adapters.values()))
        for bus in config.buses
    ]
    if not (all(simulated) or all(real)):
        i = real.index(False)
        yield Problem(
            ("buses", i, "device"), "simulated and real buses cannot be mixed; use sim for all or none"
        )


def _channels(bus: Bus, i: int) -> Iterator[Problem]:
    if bus.channels and bus.adapters:
        yield Problem(
            ("buses", i, "legs", next(iter(bus.adapters))),
            "the multiplexer is driven by the kernel or by footsense, never by both: "
            "name an adapter for every leg, or a channel for every leg",
        )
    leg_of: dict[str, str] = {}
    for leg, device in bus.adapters.items():
        if device in leg_of or device == bus.device:
            whose = f"that of {leg_of[device]}" if device in leg_of else "the bus itself"
            yield Problem(
                ("buses", i, "legs", leg), f"{device} is already {whose}; `i2cdetect -l` lists them"
            )
        leg_of[device] = leg
    leg_on: dict[int, str] = {}
    for leg, channel in bus.channels.items():
        if channel in leg_on:
            free = sorted(set(range(8)) - set(bus.channels.values()))
            yield Problem(
                ("buses", i, "legs", leg),
                f"channel {channel} is already that of {leg_on[channel]}; free channels are {free}",
            )
        leg_on[channel] = leg


def _addresses(bus: Bus, i: int, leg_devices: Mapping[int, str]) -> Iterator[Problem]:
    name_at: dict[int, str] = {}
    for k, device in enumerate(bus.other_devices):
        path = ("buses", i, "other_devices", k)
        if "pca9685" in device.name.lower() and bus.mux.address == PCA9685_ALLCALL:
            yield Problem(
                ("buses", i, "mux", "address"),
                f"{device.name} answers at 0x70 too (ALLCALL): every channel switch would reach the servos; "
                "strap the TCA9548A to 0x71 to 0x77",
            )
        if device.address in leg_devices:
            yield Problem(
                (*path, "address"),
                f"{device.name} answers at {device.address:#04x}, as does the {leg_devices[device.address]} "
                "of every leg; move it to another address or another bus",
            )
        if device.address == bus.mux.address:
            yield Problem(
                (*path, "address"),
                f"{device.name} answers at {device.address:#04x}, which is the address of the multiplexer; "
                f"change one of them",
            )
        if device.address in name_at:
            yield Problem(
                (*path, "address"),
                f"{device.name} answers at {device.address:#04x}, as does {name_at[device.address]}; "
                "change one of them, or name a device once",
            )
        name_at[device.address] = device.name


def _can_load(config: Config) -> Iterator[Problem]:
    # Forces after every conversion are nine times as many as after every scan.
    per_s = config.rate_sps if config.publish == "element" else 1e3 / config.shortest_scan_ms
    bits_per_s = len(config.legs) * _FRAMES_PER_LEG * _LONGEST_FRAME_BITS * per_s
    if config.can.interface == "socketcan" and bits_per_s > _CAN_SHARE * config.can.bitrate:
        yield Problem(
            ("can", "bitrate"),
            f"{len(config.legs)} legs at {per_s:.0f} forces/s take {bits_per_s * 1e-3:.0f} kbit/s, more than "
            f"{_CAN_SHARE:.0%} of {config.can.bitrate * 1e-3:.0f} kbit/s; use 1000000, or publish: frame",
        )


def _feet(config: Config) -> Iterator[Problem]:
    leg_of: dict[str, str] = {}
    for leg, foot in config.feet.items():
        if foot in leg_of:
            yield Problem(("feet", leg), f"{foot} is already mounted on {leg_of[foot]}")
        leg_of[foot] = leg
    sections = (
        ("feet", set(config.feet)),
        ("stray_pf", set(config.stray_pf)),
        ("unloaded_pf", set(config.unloaded_pf)),
    )
    for section, legs in sections:
        for leg in sorted(legs):
            if leg not in config.legs:
                yield Problem(
                    (section, leg), f"no bus has the leg {leg}; the legs are {', '.join(config.legs)}"
                )


def _calibrations(config: Config) -> Iterator[Problem]:
    if config.calibrations is None:
        return
    if not config.feet:
        yield Problem(
            ("calibrations",), "no foot is named that a calibration could be for; name them under feet"
        )
    if config.model is not None:
        yield Problem(
            ("model",),
            "each calibration brings the network that it was fitted on; take model or calibrations away",
        )
    for section, legs in (("stray_pf", set(config.stray_pf)), ("unloaded_pf", set(config.unloaded_pf))):
        for leg in sorted(legs):
            if leg in config.feet:
                yield Problem(
                    (section, leg),
                    f"the calibration of {config.feet[leg]} says what it is; take this entry away",
                )


def _metrics(address: str) -> Iterator[Problem]:
    try:
        ip_address(address)
    except ValueError:
        yield Problem(("metrics", "address"), f"{address!r} is not an IP address; such as 127.0.0.1")
