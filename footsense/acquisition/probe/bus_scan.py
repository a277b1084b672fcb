"""Looks at a bus before anything is scanned: who answers where, which chips are the right ones, what it costs.

Only questions that no chip minds go to addresses of which nothing is known (`address_census.py`). The mux is switched,
and the converter of a leg is asked for its identity; nothing else is written.
"""

import logging
from collections.abc import Collection, Mapping
from typing import NamedTuple

from firmware_interface import tca9548a
from footsense.acquisition.bus_timing import Timing, measure, timing
from footsense.acquisition.probe.address_scan import Census, take_census
from footsense.acquisition.scan_plan import ScanPlan
from footsense.acquisition.upstream_bus import Trunk
from footsense.errors import BusError, BusTimeoutError, HardwareError, NackError, WrongChipError
from footsense.frames import Reading
from footsense.ports import Clock, I2cBus, Transaction

__all__ = ["BusSeen", "Place", "leg_addresses", "look_at_adapters", "look_at_bus"]

_log = logging.getLogger(__name__)


class Place(NamedTuple):
    """What is behind one channel of a mux.

    Attributes:
        answering: Addresses that answer there and not on the trunk.
        outcome: OK if the leg's converter is the right one; NO_ANSWER, WRONG_CHIP, BUS_STUCK, or DELAYED where it could
            not be asked.
        why: What is wrong, in words; empty if nothing is.
    """

    answering: tuple[int, ...]
    outcome: Reading
    why: str = ""


class BusSeen(NamedTuple):
    """What is on one bus.

    Attributes:
        trunk: Who answers with no channel connected; None if a line is held.
        mux_answers: Whether the mux holds what it is told; True where the kernel drives it.
        places: What is behind each channel, by its number, as far as they could be connected; where the kernel drives
            the mux, behind each leg's adapter, by the leg's place among them.
        timing: What it costs and allows; None if nothing answered that could be timed.
    """

    trunk: Census | None
    mux_answers: bool
    places: dict[int, Place]
    timing: Timing | None


def leg_addresses(plan: ScanPlan) -> tuple[int, ...]:
    """Return the addresses of a leg's chips: the converter's first, then those of its switches."""
    step = plan.steps[0]
    return (step.trigger.address, *(select.address for select in step.select))


def look_at_bus(
    trunk: Trunk, clock: Clock, plan: ScanPlan, channels: Mapping[str, int], claimed: Collection[int] = ()
) -> BusSeen:
    """Look at a bus whose mux footsense drives.

    Args:
        trunk: The bus.
        clock: The time that it lives in.
        plan: What is to be scanned.
        channels: Mux channel of each leg.
        claimed: Addresses that the kernel uses.
    """
    census, has_mux = None, False
    try:
        if trunk.free() or not _is_held(trunk):
            census = take_census(trunk.bus, claimed)
            has_mux = _has_selected(trunk, ())
    except BusError as error:
        _log.info("the trunk: %s", error)
    if census is None or not has_mux:
        return BusSeen(census, mux_answers=False, places={}, timing=None)
    limits = timing(
        measure(trunk.bus, clock, trunk.mux_address), plan, max(len(channels), 1), kernel_mux=False
    )
    known = {*claimed, *census.answering, *census.unasked}
    places = {}
    for channel in range(tca9548a.CHANNELS):
        try:
            if not _has_selected(trunk, (channel,)):
                return BusSeen(census, mux_answers=False, places={}, timing=None)
            places[channel] = _place(trunk.bus, clock, plan, known, is_leg=channel in channels.values())
        except BusTimeoutError as error:
            places[channel] = Place((), Reading.BUS_STUCK, str(error))
            if not trunk.free():
                break
        except BusError as error:
            places[channel] = Place((), Reading.DELAYED, str(error))
    trunk.free()
    return BusSeen(census, mux_answers=True, places=places, timing=limits)


def look_at_adapters(
    adapters: Mapping[str, I2cBus], clock: Clock, plan: ScanPlan, claimed: Collection[int] = ()
) -> BusSeen:
    """Look at a bus whose mux the kernel drives, through the adapter of each leg; arguments as of `look_at_bus`."""
    places: dict[int, Place] = {}
    limits = None
    for number, bus in enumerate(adapters.values()):
        try:
            place = _place(bus, clock, plan, claimed, is_leg=True)
        except BusTimeoutError as error:
            place = Place((), Reading.BUS_STUCK, str(error))
        places[number] = place
        if limits is None and place.outcome is Reading.OK:
            costs = measure(bus, clock, plan.steps[0].select[0].address)
            limits = timing(costs, plan, len(adapters), kernel_mux=True)
    # What answers behind every channel is on the trunk.
    common = set.intersection(*(set(place.answering) for place in places.values())) - set(leg_addresses(plan))
    places = {
        number: place._replace(answering=tuple(a for a in place.answering if a not in common))
        for number, place in places.items()
    }
    return BusSeen(Census(tuple(sorted(common))), mux_answers=True, places=places, timing=limits)


def _is_held(trunk: Trunk) -> bool:
    """Tell whether a bus whose mux does not answer is held low, rather than without a mux."""
    try:
        trunk.connect(())
    except BusTimeoutError:
        return True
    except BusError:
        return False
    return False


def _has_selected(trunk: Trunk, channels: tuple[int, ...]) -> bool:
    """Connect these channels, and tell whether the mux holds that; what only shares its address does not.

    Raises:
        BusTimeoutError: A line is held low.
        BusError: The transaction failed otherwise.
    """
    try:
        trunk.connect(channels)
        held = trunk.bus.transfer(Transaction(trunk.mux_address, b"", n_read=1))
    except NackError:
        return False
    return held == bytes((tca9548a.select(channels),))


def _place(bus: I2cBus, clock: Clock, plan: ScanPlan, leave_alone: Collection[int], *, is_leg: bool) -> Place:
    """Return what answers behind the channel that is connected.

    Raises:
        BusTimeoutError: A line is held low.
    """
    answering = take_census(bus, leave_alone).answering
    if not is_leg:
        return Place(answering, Reading.OK)
    converter, *switches = leg_addresses(plan)
    try:
        plan.board.identify(bus, clock)
    except BusTimeoutError:
        raise
    except WrongChipError as error:
        return Place(answering, Reading.WRONG_CHIP, str(error))
    except (NackError, BusError) as error:
        return Place(answering, Reading.DELAYED, str(error))
    except HardwareError as error:
        return Place(answering, Reading.NO_ANSWER, str(error))
    for address in switches:
        if address not in answering and address not in leave_alone:
            why = f"no line switch answers at {address:#04x}, though a converter does at {converter:#04x}"
            return Place(answering, Reading.NO_ANSWER, why)
    return Place(answering, Reading.OK)
