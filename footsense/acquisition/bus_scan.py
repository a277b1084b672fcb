"""Scan of an I2C bus for chips: answering addresses, chip identities, bus timing.

Unknown addresses receive only transactions that are harmless to the chips. The mux is switched, and
the identity of each leg's converter is read, and of what else may be an AD7147; nothing else is written.

An empty write is the gentlest: START, address, acknowledge, STOP. But to the EEPROM AT24RF08 (0x54 to 0x57) it is the
beginning of a write, and memory modules have write-protect registers at 0x30 to 0x37: there one byte is read instead,
which in turn locks up write-only clock chips such as those at 0x69. `i2cdetect` does the same by default. Addresses
below 0x08 and above 0x77 are reserved (UM10204, table 4); they and chips held by a driver of the kernel are left alone.
"""

import logging
from collections.abc import Callable, Collection, Mapping
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

from firmware_interface.chips import ad7147 as ad7147_chip
from firmware_interface.chips import tca9548a
from footsense.acquisition.boards import ad7147, fdc1004
from footsense.acquisition.bus_timing import BusTiming, measure_bus_timing
from footsense.acquisition.leg_bus import LegBus, release_sda
from footsense.acquisition.scan_plan import AnyPlan, FreeRunningPlan, ScanPlan
from footsense.errors import HardwareError, I2cError, I2cTimeoutError, NackError, WrongChipError
from footsense.frames import Reading
from footsense.ports import Clock, I2cBus, Transaction

_log = logging.getLogger(__name__)


#: Addresses that a chip may have.
ADDRESSES = range(0x08, 0x78)

#: Bytes that are read of what may be an AD7147: of so many of its registers, not all bytes are alike.
_N_REPEATED_BYTES = 64

_ADDRESSES_PROBED_BY_READ = {*range(0x30, 0x38), *range(0x50, 0x60)}


class TimeLimitedBus:
    """Bus whose scan ends after a while: some adapters need up to a second to report that no chip answers.

    Args:
        bus: The bus.
        clock: Its clock.
        device: Name of its adapter.
        limit_s: Time from now on in which transactions may begin [s].
    """

    def __init__(self, bus: I2cBus, clock: Clock, device: str, limit_s: float) -> None:
        self._bus, self._clock, self._device, self._limit_s = bus, clock, device, limit_s
        self._end_ns = clock.now_ns() + round(limit_s * 1e9)
        self._n = 0

    def transfer(self, transaction: Transaction) -> bytes:
        """Do one transaction.

        Raises:
            HardwareError: The time is over.
            I2cError: The transaction failed.
        """
        if self._clock.now_ns() > self._end_ns:
            raise HardwareError(
                f"{self._device}: the scan was given up after {self._limit_s:g} s: this adapter does "
                f"{self._n / self._limit_s:.1f} transactions/s, as it tells slowly that no chip answers; use another "
                "one, or write the robot's file by hand: deploy/footsense.yaml"
            )
        self._n += 1
        return self._bus.transfer(transaction)


class AddressProbe(NamedTuple):
    """Result of an address scan: I2C addresses that answered, and those that were not probed.

    Attributes:
        answering: Addresses that acknowledged.
        unprobeable: Addresses that this adapter cannot probe, most often because it does not support empty writes.
    """

    answering: tuple[int, ...]
    unprobeable: tuple[int, ...] = ()


def probe_addresses(bus: I2cBus, skipped: Collection[int] = ()) -> AddressProbe:
    """Probe every I2C address once; return which acknowledged.

    Args:
        bus: The bus, with the channels that are connected.
        skipped: Addresses not to probe.

    Raises:
        I2cTimeoutError: A line is stuck: no chip can answer.
    """
    answering, not_probed = [], []
    for address in ADDRESSES:
        if address in skipped:
            continue
        try:
            bus.transfer(Transaction(address, b"", int(address in _ADDRESSES_PROBED_BY_READ)))
        except NackError:
            continue
        except I2cTimeoutError:
            raise
        except I2cError:
            not_probed.append(address)
        else:
            answering.append(address)
    return AddressProbe(tuple(answering), tuple(not_probed))


class LegScan(NamedTuple):
    """Chips found of one leg.

    Attributes:
        answering: Addresses that answer where it is connected: behind its mux channel, or its converter's alone where
            several legs share an adapter.
        outcome: OK if its converter is the right one; NO_ANSWER, WRONG_CHIP, BUS_STUCK, or DELAYED where it could
            not be asked.
        why: The fault in words; empty for OK.
    """

    answering: tuple[int, ...]
    outcome: Reading
    why: str = ""


class ChannelScan(NamedTuple):
    """Chips found behind one mux channel.

    Attributes:
        answering: Addresses that answer there and not on the upstream bus.
        legs: Its legs.
        ad7147: Those of the addresses at which an AD7147 is, with board `ad7147`.
    """

    answering: tuple[int, ...]
    legs: Mapping[str, LegScan] = MappingProxyType({})
    ad7147: tuple[int, ...] = ()


class BusScan(NamedTuple):
    """Chips found on one I2C bus, and the bus's timing.

    Attributes:
        upstream: Addresses that answer with no channel connected; None if a line is stuck, of a bus without a mux if it
            has several legs.
        mux_answers: Whether the mux holds its selection; True without one.
        channels: Chips behind each channel by number, as far as it could be connected; without a mux, on the bus as
            channel 0, and `upstream` names none.
        bus_timing: Cost of transactions and limits of the scan; None if no chip answered that could be timed.
    """

    upstream: AddressProbe | None
    mux_answers: bool
    channels: dict[int, ChannelScan]
    bus_timing: BusTiming | None

    @property
    def legs(self) -> dict[str, LegScan]:
        """Chips of each leg whose channel could be connected."""
        return {leg: found for channel in self.channels.values() for leg, found in channel.legs.items()}


def leg_chip_addresses(plan: AnyPlan) -> tuple[int, ...]:
    """Return the I2C addresses that the chips of every leg behind a mux have: the converter's first."""
    if isinstance(plan, FreeRunningPlan):
        return ad7147_chip.ADDRESSES[:1]
    return plan.steps[0].trigger.address, plan.steps[0].select.address


def is_ad7147(bus: I2cBus, address: int) -> bool:
    """Return whether the chip that acknowledges at an address is an AD7147.

    To ask for its identity writes two bytes, which would set a digital potentiometer. One with a single register
    repeats that when more is read: such a chip is not asked.

    Raises:
        I2cTimeoutError: A line is stuck.
    """
    try:
        if len(set(bus.transfer(Transaction(address, b"", _N_REPEATED_BYTES)))) == 1:
            return False
        ad7147.check_identity(bus, address)
    except I2cTimeoutError:
        raise
    except HardwareError:
        return False
    return True


def scan_bus(
    bus: LegBus,
    clock: Clock,
    plan: AnyPlan,
    legs: Mapping[str, int],
    addresses: Mapping[str, int] = MappingProxyType({}),
    claimed: Collection[int] = (),
) -> BusScan:
    """Return the chips found on a bus, and its timing.

    Args:
        bus: The bus.
        clock: Clock of the bus.
        plan: The scan to come.
        legs: Mux channel of each leg.
        addresses: Address of the converter of each leg, of board `ad7147`.
        claimed: Addresses that drivers of the kernel hold.
    """
    if bus.mux_address is None:
        return _scan_without_mux(bus, clock, plan, {leg: addresses.get(leg, 0) for leg in legs}, claimed)
    upstream, has_mux = None, False
    try:
        bus.free_bus()
        upstream = probe_addresses(bus.adapter, claimed)  # a stuck line times out
        has_mux = _select_and_check_read_back(bus, bus.mux_address, 0)
    except I2cError as error:
        _log.info("the upstream bus: %s", error)
    if upstream is None or not has_mux:
        return BusScan(upstream, mux_answers=False, channels={}, bus_timing=None)
    timing = measure_bus_timing(bus, clock, plan, max(len(legs), 1), ())
    known = {*claimed, *upstream.answering, *upstream.unprobeable}
    channels = {}
    for channel in range(tca9548a.N_CHANNELS):
        own = {leg: addresses.get(leg, 0) for leg, its_channel in legs.items() if its_channel == channel}
        try:
            selection = tca9548a.channel_control_byte(channel)
            if not _select_and_check_read_back(bus, bus.mux_address, selection):
                return BusScan(upstream, mux_answers=False, channels={}, bus_timing=None)
            channels[channel] = _scan_channel(bus.adapter, plan, known, own)
        except I2cTimeoutError as error:
            channels[channel] = _failed(own, Reading.BUS_STUCK, error)
            if not bus.free_bus():
                break
        except I2cError as error:
            channels[channel] = _failed(own, Reading.DELAYED, error)
    bus.free_bus()
    return BusScan(upstream, mux_answers=True, channels=channels, bus_timing=timing)


def _failed(legs: Collection[str], outcome: Reading, error: I2cError) -> ChannelScan:
    return ChannelScan((), dict.fromkeys(legs, LegScan((), outcome, str(error))))


def _scan_without_mux(
    bus: LegBus, clock: Clock, plan: AnyPlan, addresses: Mapping[str, int], claimed: Collection[int]
) -> BusScan:
    """Return the chips of legs that are directly on their adapter."""
    timing = None
    try:
        found = _scan_channel(bus.adapter, plan, claimed, addresses)
        timed = [
            addresses[leg] if isinstance(plan, FreeRunningPlan) else plan.harmless_read.address
            for leg, chips in found.legs.items()
            if chips.outcome is Reading.OK
        ]
        timing = measure_bus_timing(bus, clock, plan, len(addresses), timed)
    except I2cTimeoutError as error:
        if len(addresses) > 1:  # any of them may hold the line
            return BusScan(None, mux_answers=True, channels={}, bus_timing=None)
        found = _failed(addresses, Reading.BUS_STUCK, error)
    except I2cError as error:
        found = _failed(addresses, Reading.DELAYED, error)
    return BusScan(AddressProbe(()), mux_answers=True, channels={0: found}, bus_timing=timing)


def _select_and_check_read_back(bus: LegBus, mux_address: int, selection: int) -> bool:
    """Select mux channels, and return whether the mux reads them back, as no other chip would.

    Raises:
        I2cTimeoutError: A line is stuck.
        I2cError: The transaction failed otherwise.
    """
    try:
        read_back = bus.connect(selection).transfer(Transaction(mux_address, b"", n_read=1))
    except NackError:
        return False
    return read_back == bytes((selection,))


def _scan_channel(
    bus: I2cBus, plan: AnyPlan, skipped: Collection[int], addresses: Mapping[str, int]
) -> ChannelScan:
    """Return the chips behind the mux channel that is connected, whose legs' converters have these addresses.

    Raises:
        I2cTimeoutError: A line is stuck.
    """
    release_sda(bus)
    answering = probe_addresses(bus, skipped).answering
    if isinstance(plan, ScanPlan):
        of_legs = {leg: _scan_triggered_leg(bus, plan, answering, skipped) for leg in addresses}
        return ChannelScan(answering, of_legs)
    legs = {
        leg: _leg_scan(tuple({address} & {*answering}), partial(ad7147.check_identity, bus, address))
        for leg, address in addresses.items()
    }
    known = {addresses[leg] for leg, chips in legs.items() if chips.outcome is Reading.OK}
    others = {*answering} & {*ad7147_chip.ADDRESSES} - {*addresses.values()}
    known |= {address for address in others if is_ad7147(bus, address)}
    return ChannelScan(answering, legs, tuple(sorted(known)))


def _scan_triggered_leg(
    bus: I2cBus, plan: ScanPlan, answering: tuple[int, ...], skipped: Collection[int]
) -> LegScan:
    """Return the chips of the leg that is connected, whose conversions are triggered."""
    found = _leg_scan(answering, partial(fdc1004.check_identity, bus))
    if found.outcome is not Reading.OK:
        return found
    converter, switch = leg_chip_addresses(plan)
    if switch not in answering and switch not in skipped:
        why = f"no row switch answers at {switch:#04x}, though a converter does at {converter:#04x}"
        return LegScan(answering, Reading.NO_ANSWER, why)
    return found


def _leg_scan(answering: tuple[int, ...], check_identity: Callable[[], None]) -> LegScan:
    """Return the chips of a leg whose converters are asked for their identity.

    Raises:
        I2cTimeoutError: A line is stuck.
    """
    try:
        check_identity()
    except I2cTimeoutError:
        raise
    except WrongChipError as error:
        return LegScan(answering, Reading.WRONG_CHIP, str(error))
    except (NackError, I2cError) as error:
        return LegScan(answering, Reading.DELAYED, str(error))
    except HardwareError as error:
        return LegScan(answering, Reading.NO_ANSWER, str(error))
    return LegScan(answering, Reading.OK)
