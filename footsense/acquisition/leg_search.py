"""Search for the legs of a bus: at start, and later for those left out of the scan."""

from collections.abc import Sequence

from footsense.acquisition.leg_connection import STUCK_BUS_PAUSE_FACTOR, STUCK_LEG_PAUSE_FACTOR, LegConnection
from footsense.acquisition.scan_plan import ScanPlan
from footsense.acquisition.transports import Transport, release_sda
from footsense.errors import HardwareError, I2cError, I2cTimeoutError, WrongChipError
from footsense.frames import Reading
from footsense.ports import Clock, I2cBus


def probe_leg(
    transport: Transport, leg: LegConnection, bus_legs: Sequence[LegConnection], plan: ScanPlan, clock: Clock
) -> None:
    """Probe one leg's chips; add the leg to the scan, or delay the next try.

    Args:
        transport: The way to its chips.
        leg: The leg.
        bus_legs: All legs of the bus. If the bus itself is stuck, the waiting ones are put off too: one of them is
            enough to find out when it gets free.
        plan: The scan, whose first lines the leg gets.
        clock: The time that the bus lives in.
    """
    try:
        bus = transport.connect(leg.selection)
    except I2cTimeoutError as error:
        leg.leave_scan(Reading.BUS_STUCK, clock.now_ns(), str(error), STUCK_BUS_PAUSE_FACTOR)
        for other in bus_legs:
            if not other.in_scan:
                other.retry_at_ns = max(other.retry_at_ns, leg.retry_at_ns)
    except I2cError as error:
        leg.leave_scan(Reading.NO_ANSWER, clock.now_ns(), str(error))
    else:
        _set_up_leg(bus, leg, plan, clock)
        if leg.outcome is Reading.BUS_STUCK:
            transport.free_bus()


def _set_up_leg(bus: I2cBus, leg: LegConnection, plan: ScanPlan, clock: Clock) -> None:
    """Set up the chips of the only connected leg; add the leg to the scan, or delay the next try."""
    now_ns = clock.now_ns()
    try:
        release_sda(bus)
        plan.board.check_identity(bus, clock)
        reading, offset_pf = plan.board.configure_and_get_capdac_pf(bus, clock)
        for step in filter(None, (leg.doubted, plan.steps[0])):
            for write in step.select:
                bus.transfer(write)
            if step is leg.doubted and any(bus.transfer(ask) != held for ask, held in step.select_checks):
                reading = Reading.MISCONFIGURED
    except I2cTimeoutError as error:
        leg.leave_scan(Reading.BUS_STUCK, now_ns, str(error), STUCK_LEG_PAUSE_FACTOR)
    except WrongChipError as error:
        leg.leave_scan(Reading.WRONG_CHIP, now_ns, str(error))
    except HardwareError as error:
        leg.leave_scan(Reading.NO_ANSWER, now_ns, str(error))
    else:
        if reading is Reading.OK:
            leg.join_scan(offset_pf)
        else:
            leg.leave_scan(reading, now_ns)


def probe_due_legs(transport: Transport, legs: Sequence[LegConnection], plan: ScanPlan, clock: Clock) -> None:
    """Probe the leg that has waited longest, if one is due; at most one per scan, to keep the scan's pace.

    If no leg is in the scan, all that are due are tried, until one finds the bus stuck.
    """
    now_ns = clock.now_ns()
    alone = not any(leg.in_scan for leg in legs)
    due = [leg for leg in legs if not leg.in_scan and leg.retry_at_ns <= now_ns]
    if alone and due:
        transport.free_bus()  # any leg may hold the lines
    for leg in sorted(due, key=lambda leg: leg.retry_at_ns)[: len(due) if alone else 1]:
        outcome = leg.outcome
        probe_leg(transport, leg, legs, plan, clock)
        if leg.in_scan:
            # It does not take part in the conversion that runs, and joins with the next scan.
            leg.outcome = outcome
        elif leg.outcome is Reading.BUS_STUCK:
            return
