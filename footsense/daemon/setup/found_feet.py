"""Find the feet of a robot that has no file yet: on I2C adapters, or behind the serial port of a microcontroller."""

from collections.abc import Collection, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from firmware_interface.chips import ad7147, fdc1004, tca9548a
from footsense.acquisition.bus_scan import (
    ADDRESSES,
    TimeLimitedBus,
    is_ad7147,
    leg_chip_addresses,
    probe_addresses,
    scan_bus,
)
from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.linux_i2c import LinuxI2cBus, adapter_names, kernel_drivers
from footsense.acquisition.mcu_source import Serial
from footsense.acquisition.scan_plan import FASTEST_SPS, scan_plan
from footsense.can.interface import Can
from footsense.clock import MonotonicClock
from footsense.config import SMALL_BOARD, Config
from footsense.config.sections import Bus, Mux
from footsense.daemon.acquisition import open_scan_source
from footsense.daemon.setup.probe import MUX_ADDRESSES, SEARCH_LIMIT_S
from footsense.daemon.simulation import simulated_robot
from footsense.errors import ConfigError, HardwareError
from footsense.estimation.noise import NOISE_SAMPLES
from footsense.frames import ALL_LEGS, LEGS
from footsense.leg_words import IS_SILENT
from footsense.ports import Clock, I2cBus
from footsense.sim.scene import Scene

#: Device of a simulated robot.
SIMULATED = "sim"

_SERIAL_PORTS = Path("/dev/serial/by-id")
#: Legs of robots that have fewer than six, in the order of their channels.
_LEGS_OF_N = {len(legs): legs for legs in (("lf",), ("lf", "rf"), ("lf", "lr", "rf", "rr"))}
#: Scan of feet with board `fdc1004`, and the addresses of their chips.
_FDC1004_PLAN = scan_plan(FASTEST_SPS)
_FDC1004_CHIPS = leg_chip_addresses(_FDC1004_PLAN)
#: Address of an AD7147 behind a multiplexer.
_AD7147_BEHIND_MUX = ad7147.ADDRESSES[0]


class FoundFeet(NamedTuple):
    """Feet whose converters answer on one I2C adapter.

    Attributes:
        device: The adapter.
        board: Their electronics.
        mux_address: Address of their multiplexer; None for feet directly on the adapter.
        channels: Channel of each foot; 0 without a multiplexer.
        addresses: Address of each foot's converter, of board `ad7147` without a multiplexer.
    """

    device: str
    board: str
    mux_address: int | None
    channels: tuple[int, ...]
    addresses: tuple[int, ...] = ()

    def bus(self, legs: Sequence[str]) -> Bus:
        """Return the section of a configuration that has these feet on these legs."""
        if self.addresses:
            addresses = dict(zip(legs, self.addresses, strict=True))
            return Bus(device=self.device, addresses=addresses)  # type: ignore[arg-type]
        if self.mux_address is None:
            return Bus(device=self.device, leg=legs[0])  # type: ignore[arg-type]
        channels = dict(zip(legs, self.channels, strict=True))
        return Bus(device=self.device, mux=Mux(address=self.mux_address), legs=channels)  # type: ignore[arg-type]


def devices() -> dict[str, str]:
    """Return what this computer's I2C adapters and serial ports call themselves, by their device files."""
    ports = sorted(_SERIAL_PORTS.glob("*"))
    return adapter_names() | {str(port): "serial port" for port in ports}


def find_feet(device: str, adapter: I2cBus, clock: Clock, claimed: Collection[int] = ()) -> FoundFeet | None:
    """Return the feet that answer on an adapter; None if there are none.

    Every address is asked for an acknowledge. Only what then answers at an address of a multiplexer is written to, and
    switched only if it reads back as one; and what answers at an address of an AD7147 is asked for its identity.

    Args:
        device: Name of the adapter.
        adapter: The adapter.
        clock: Its clock.
        claimed: Addresses that drivers of the kernel hold.

    Raises:
        I2cError: A line is held low, or the multiplexer fails.
        HardwareError: The adapter is too slow to be searched.
    """
    adapter = TimeLimitedBus(adapter, clock, device, SEARCH_LIMIT_S)
    answering = set(probe_addresses(adapter, claimed).answering)
    found = [FoundFeet(device, "fdc1004", None, (0,))] if answering.issuperset(_FDC1004_CHIPS) else []
    addresses = tuple(
        address for address in ad7147.ADDRESSES if address in answering and is_ad7147(adapter, address)
    )
    if addresses:
        found.append(FoundFeet(device, "ad7147", None, (0,) * len(addresses), addresses))
    for address in sorted(answering.intersection(MUX_ADDRESSES)):
        found += _feet_behind(device, LegBus(adapter, address), clock, claimed)
    return max(found, key=lambda feet: len(feet.channels), default=None)


def _feet_behind(device: str, bus: LegBus, clock: Clock, claimed: Collection[int]) -> Iterator[FoundFeet]:
    """Yield the feet of each board behind a multiplexer, whose channels are asked for the chips of feet alone."""
    skipped = {*claimed} | {*ADDRESSES}.difference(_FDC1004_CHIPS, [_AD7147_BEHIND_MUX])
    scan = scan_bus(bus, clock, _FDC1004_PLAN, {}, claimed=skipped)
    single = tuple(
        number
        for number, chips in scan.channels.items()
        if _AD7147_BEHIND_MUX in chips.answering
        and is_ad7147(bus.connect(tca9548a.channel_control_byte(number)), _AD7147_BEHIND_MUX)
    )
    if single:
        yield FoundFeet(device, "ad7147", bus.mux_address, single)
    bus.free_bus()
    channels = tuple(number for number, chips in scan.channels.items() if fdc1004.ADDRESS in chips.answering)
    if channels:
        yield FoundFeet(device, "fdc1004", bus.mux_address, channels)


def robot_on(devices: Sequence[str], legs: Sequence[str], can: Can, scene: Scene) -> Config:
    """Return the configuration of a robot with the feet that answer on some devices.

    Args:
        devices: I2C adapters, one serial port, or `sim`, `sim1`, ... for simulated buses, which share the legs.
        legs: Names of the legs, in the order of devices and channels; none for those usual for so many feet. A
            microcontroller names its legs itself.
        can: Where its forces go.
        scene: Scene of a simulated robot.

    Raises:
        HardwareError: No foot answers, or a device is missing.
        ConfigError: The legs do not fit the feet.
    """
    serial = [device for device in devices if device.startswith(("/dev/tty", "/dev/serial/"))]
    if serial:
        if len(devices) > 1:
            raise ConfigError(f"{serial[0]}: a microcontroller scans all feet; name this device alone")
        return _robot_on_microcontroller(serial[0], can)
    if len({*devices}) < len(devices):
        raise ConfigError(f"{' '.join(devices)}: a device is named twice; simulated buses are sim, sim1, ...")
    simulated = [device for device in devices if device.startswith(SIMULATED)]
    wired = np.array_split(legs or LEGS, len(simulated) or 1)
    legs_of = {device: part.tolist() for device, part in zip(simulated, wired, strict=False)}
    found = [
        feet for device in devices if (feet := _open_and_find(device, legs_of.get(device), scene)) is not None
    ]
    if not found:
        names = ", ".join(devices)
        raise HardwareError(
            f"{names}: no foot answers, neither behind a TCA9548A nor directly; check supply and wires, or write the "
            "file by hand: deploy/footsense.yaml"
        )
    return robot_of(found, legs, can)


def robot_of(found: Sequence[FoundFeet], legs: Sequence[str], can: Can) -> Config:
    """Return the configuration of a robot with these feet.

    Raises:
        ConfigError: They are of two boards, or the legs do not fit them.
    """
    boards = {feet.board for feet in found}
    if len(boards) > 1:
        raise ConfigError(
            f"feet of the boards {' and '.join(sorted(boards))} answer; a robot has feet of one board"
        )
    n = sum(len(feet.channels) for feet in found)
    if legs and len(legs) != n:
        raise ConfigError(f"{n} feet answer, and {len(legs)} legs are named: {' '.join(legs)}")
    left = iter(legs or _usual_legs(found))
    buses = tuple(feet.bus([next(left) for _ in feet.channels]) for feet in found)
    return Config(board=boards.pop(), buses=buses, can=can)  # type: ignore[arg-type]


def _usual_legs(found: Sequence[FoundFeet]) -> Sequence[str]:
    """Return the legs of a robot with so many feet; of six legs of which some are missing, those by their channels.

    Raises:
        ConfigError: They are more than a robot has.
    """
    channels = [channel for feet in found for channel in feet.channels]
    if len(channels) > len(ALL_LEGS):
        raise ConfigError(f"{len(channels)} feet answer; a robot has at most {len(ALL_LEGS)}")
    by_channel = tuple(ALL_LEGS[channel] for channel in channels)
    has_one_mux = len(found) == 1 and found[0].mux_address is not None
    return _LEGS_OF_N.get(len(channels)) or (by_channel if has_one_mux else ALL_LEGS[: len(channels)])


def _open_and_find(device: str, legs: Sequence[str] | None, scene: Scene) -> FoundFeet | None:
    """Open an adapter and return the feet on it; those of a simulated one are on these legs."""
    if legs is not None:
        wired = Bus(device=device, legs={leg: channel for channel, leg in enumerate(legs)})  # type: ignore[misc]
        wires = simulated_robot(replace(SMALL_BOARD, buses=(wired,)), scene).buses[0]
        return find_feet(device, wires, wires.clock)
    with closing(LinuxI2cBus.open(device)) as adapter:
        return find_feet(device, adapter, MonotonicClock(), kernel_drivers(device))


def _robot_on_microcontroller(device: str, can: Can) -> Config:
    """Return the configuration of a robot with the legs of which a microcontroller sends records.

    Raises:
        HardwareError: It sends none, or the port is missing.
    """
    config = Config(board="mcu", serial=Serial(device=device, legs=ALL_LEGS), can=can)  # type: ignore[arg-type]
    with open_scan_source(config, None) as started:
        readings = np.stack([frame.reading for frame in started.read_whole_scans(NOISE_SAMPLES)])
    is_silent = IS_SILENT[readings].all(axis=(0, 2))
    legs = tuple(ALL_LEGS[row] for row in np.flatnonzero(~is_silent))
    if not legs:
        raise HardwareError(
            f"{device}: no record of a microcontroller in {NOISE_SAMPLES} scans; is its firmware footsense's?"
        )
    return replace(config, serial=Serial(device=device, legs=legs))  # type: ignore[arg-type]
