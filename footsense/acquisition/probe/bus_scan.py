"""Scan of an I2C bus for chips: answering addresses, chip identities, bus timing.

Unknown addresses receive only transactions that are harmless to the chips (`address_scan.py`). The mux is switched, and
the identity of each leg's converter is read. An AD7746 has none but its values after a reset, so that it is reset;
nothing else is written.
"""

import logging
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from firmware_interface.chips import tca9548a
from footsense.acquisition.bus_timing import BusTiming, bus_timing, measure_bus_costs
from footsense.acquisition.probe.address_scan import AddressProbe, probe_addresses
from footsense.acquisition.scan_plan import ScanPlan
from footsense.acquisition.transports import UpstreamBus, release_sda
from footsense.errors import HardwareError, I2cError, I2cTimeoutError, NackError, WrongChipError
from footsense.frames import Reading
from footsense.ports import Clock, I2cBus, Transaction

_log = logging.getLogger(__name__)


class ChannelScan(NamedTuple):
    """Chips found behind one mux channel.

    Attributes:
        answering: Addresses that answer there and not on the upstream bus.
        outcome: OK if the leg's converter is the right one; NO_ANSWER, WRONG_CHIP, BUS_STUCK, or DELAYED where it could
            not be asked.
        why: The fault in words; empty for OK.
    """

    answering: tuple[int, ...]
    outcome: Reading
    why: str = ""


class BusScan(NamedTuple):
    """Chips found on one I2C bus, and the bus's timing.

    Attributes:
        upstream: Addresses that answer with no channel connected; None if a line is stuck.
        mux_answers: Whether the mux holds its selection; True where the kernel drives it.
        channels: Chips behind each channel by number, as far as it could be connected; where the kernel drives the mux,
            behind each leg's adapter, by the leg's position.
        bus_timing: Cost of transactions and limits of the scan; None if no chip answered that could be timed.
    """

    upstream: AddressProbe | None
    mux_answers: bool
    channels: dict[int, ChannelScan]
    bus_timing: BusTiming | None


def leg_chip_addresses(plan: ScanPlan) -> tuple[int, ...]:
    """Return the I2C addresses of a leg's chips: the converter's first, then the line switches'."""
    step = plan.steps[0]
    return (step.trigger.address, *(select.address for select in step.select))


def scan_bus(
    bus: UpstreamBus, clock: Clock, plan: ScanPlan, legs: Mapping[str, int], claimed: Collection[int] = ()
) -> BusScan:
    """Return the chips found on a bus whose mux footsense itself switches, and the bus's timing.

    Args:
        bus: The bus.
        clock: Clock of the bus.
        plan: The scan to come.
        legs: Mux channel of each leg.
        claimed: Addresses that drivers of the kernel hold.
    """
    upstream, has_mux = None, False
    try:
        bus.free_bus()
        upstream = probe_addresses(bus.bus, claimed)  # a stuck line times out
        has_mux = _select_and_check_read_back(bus, 0)
    except I2cError as error:
        _log.info("the upstream bus: %s", error)
    if upstream is None or not has_mux:
        return BusScan(upstream, mux_answers=False, channels={}, bus_timing=None)
    limits = bus_timing(
        measure_bus_costs(bus.bus, clock, bus.mux_address), plan, max(len(legs), 1), kernel_mux=False
    )
    known = {*claimed, *upstream.answering, *upstream.unprobeable}
    channels = {}
    for channel in range(tca9548a.N_CHANNELS):
        try:
            if not _select_and_check_read_back(bus, tca9548a.channel_control_byte(channel)):
                return BusScan(upstream, mux_answers=False, channels={}, bus_timing=None)
            channels[channel] = _scan_channel(bus.bus, clock, plan, known, is_leg=channel in legs.values())
        except I2cTimeoutError as error:
            channels[channel] = ChannelScan((), Reading.BUS_STUCK, str(error))
            if not bus.free_bus():
                break
        except I2cError as error:
            channels[channel] = ChannelScan((), Reading.DELAYED, str(error))
    bus.free_bus()
    return BusScan(upstream, mux_answers=True, channels=channels, bus_timing=limits)


def scan_adapters(
    adapters: Sequence[I2cBus], clock: Clock, plan: ScanPlan, claimed: Collection[int] = ()
) -> BusScan:
    """Return the chips found on a bus whose mux the kernel switches; arguments as of `scan_bus`.

    An address that answers behind every channel is on the upstream bus. A channel with a stuck line shows nothing of
    it; if all are stuck, the upstream bus is unknown (None). Without any adapter, nothing answers.
    """
    channels: dict[int, ChannelScan] = {}
    limits = None
    for number, bus in enumerate(adapters):
        try:
            channels[number] = _scan_channel(bus, clock, plan, claimed, is_leg=True)
        except I2cTimeoutError as error:
            channels[number] = ChannelScan((), Reading.BUS_STUCK, str(error))
        if limits is None and channels[number].outcome is Reading.OK:
            costs = measure_bus_costs(bus, clock, plan.steps[0].select[0].address)
            limits = bus_timing(costs, plan, len(adapters), kernel_mux=True)
    readable = [set(scan.answering) for scan in channels.values() if scan.outcome is not Reading.BUS_STUCK]
    common = set[int]().union(*readable).intersection(*readable) - set(leg_chip_addresses(plan))
    upstream = None if channels and not readable else AddressProbe(tuple(sorted(common)))
    channels = {
        number: scan._replace(answering=tuple(address for address in scan.answering if address not in common))
        for number, scan in channels.items()
    }
    return BusScan(upstream, mux_answers=True, channels=channels, bus_timing=limits)


def _select_and_check_read_back(bus: UpstreamBus, selection: int) -> bool:
    """Select mux channels, and return whether the mux reads them back, as no other chip would.

    Raises:
        I2cTimeoutError: A line is stuck.
        I2cError: The transaction failed otherwise.
    """
    try:
        bus.connect(selection)
        held = bus.bus.transfer(Transaction(bus.mux_address, b"", n_read=1))
    except NackError:
        return False
    return held == bytes((selection,))


def _scan_channel(
    bus: I2cBus, clock: Clock, plan: ScanPlan, skipped: Collection[int], *, is_leg: bool
) -> ChannelScan:
    """Return the chips behind the mux channel that is connected.

    Raises:
        I2cTimeoutError: A line is stuck.
    """
    release_sda(bus)
    answering = probe_addresses(bus, skipped).answering
    if not is_leg:
        return ChannelScan(answering, Reading.OK)
    converter, *switches = leg_chip_addresses(plan)
    try:
        plan.board.check_identity(bus, clock)
    except I2cTimeoutError:
        raise
    except WrongChipError as error:
        return ChannelScan(answering, Reading.WRONG_CHIP, str(error))
    except (NackError, I2cError) as error:
        return ChannelScan(answering, Reading.DELAYED, str(error))
    except HardwareError as error:
        return ChannelScan(answering, Reading.NO_ANSWER, str(error))
    for address in switches:
        if address not in answering and address not in skipped:
            why = f"no line switch answers at {address:#04x}, though a converter does at {converter:#04x}"
            return ChannelScan(answering, Reading.NO_ANSWER, why)
    return ChannelScan(answering, Reading.OK)
