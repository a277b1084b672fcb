"""Finds out which legs are on a bus: those that come back, and the one that holds a line low.

Nothing tells which of the connected legs holds a line: the whole trunk is blocked. So all are disconnected and come
back one by one, each with one question; the one whose question is not let through is it. That costs the adapter's
timeout once more for each such leg, besides the one that told of it.
"""

import logging
from collections.abc import Iterable, Sequence

from footsense.acquisition.boards.board import Board
from footsense.acquisition.leg_connection import HELD_PAUSES, HOLDER_PAUSES, LegLink
from footsense.acquisition.upstream_bus import Trunk
from footsense.errors import BusError, BusTimeoutError
from footsense.frames import Reading
from footsense.ports import Clock, Transaction

_log = logging.getLogger(__name__)


def leave_out_holders(trunk: Trunk, legs: Sequence[LegLink], ask: Transaction, clock: Clock) -> None:
    """Leave out of the scan the legs that hold a line, or all of them if the trunk itself does not get free.

    Args:
        trunk: The bus, on which a transaction has just timed out.
        legs: Those in the scan.
        ask: A read of a leg that changes nothing.
        clock: The time that the bus lives in.
    """
    free = trunk.free()
    for leg in legs:
        if free:
            try:
                trunk.connect((leg.channel,))
                trunk.bus.transfer(ask)
            except BusTimeoutError:
                free = trunk.free()
                leg.leave(
                    Reading.BUS_STUCK, "holds a line of the bus low", clock.now_ns(), pauses=HOLDER_PAUSES
                )
            except BusError as error:  # its own trouble, which the scan will see too
                _log.debug("leg %s: %s", leg.name, error)
        else:
            why = "the bus is held low and does not get free"
            leg.leave(Reading.BUS_STUCK, why, clock.now_ns(), pauses=HELD_PAUSES)


def probe(
    trunk: Trunk,
    leg: LegLink,
    others: Sequence[LegLink],
    board: Board,
    select: Iterable[Transaction],
    clock: Clock,
) -> None:
    """Look for one leg's chips and take it into the scan, or put off the next try.

    Args:
        trunk: Its bus.
        leg: The leg.
        others: All legs of the bus; if the bus itself is held, those that wait are put off too, for one of them is
            enough to find out when it gets free.
        board: The leg's electronics.
        select: Selects the lines that the other legs have now.
        clock: The time that the bus lives in.
    """
    try:
        trunk.connect((leg.channel,))
    except BusTimeoutError as error:
        leg.leave(Reading.BUS_STUCK, str(error), clock.now_ns(), pauses=HELD_PAUSES)
        for other in others:
            if not other.in_scan:
                other.retry_at_ns = max(other.retry_at_ns, leg.retry_at_ns)
    except BusError as error:
        leg.leave(Reading.NO_ANSWER, str(error), clock.now_ns())
    else:
        leg.probe(trunk.bus, board, select, clock)
        if leg.outcome is Reading.BUS_STUCK:
            trunk.free()


def probe_due(
    trunk: Trunk, legs: Sequence[LegLink], board: Board, select: Iterable[Transaction], clock: Clock
) -> None:
    """Try the leg that has waited longest, if one is due; one a scan, so that the others keep their time.

    If there are no others, all that are due are tried, until one finds the bus held.
    """
    now_ns = clock.now_ns()
    alone = not any(leg.in_scan for leg in legs)
    due = [leg for leg in legs if not leg.in_scan and leg.retry_at_ns <= now_ns]
    for leg in sorted(due, key=lambda leg: leg.retry_at_ns)[: len(due) if alone else 1]:
        outcome = leg.outcome
        probe(trunk, leg, legs, board, select, clock)
        if leg.in_scan:
            leg.outcome = outcome  # it was not told of the conversion that runs, and joins with the next scan
        elif leg.outcome is Reading.BUS_STUCK:
            return
