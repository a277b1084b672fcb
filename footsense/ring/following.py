"""A process beside a service that reads its ring: it waits for one, follows it to its end, and waits for the next."""

import logging
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Protocol

from footsense.errors import FootsenseError
from footsense.frames import Cycle
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.records import NumberedCycle

_log = logging.getLogger(__name__)

#: Time between two looks at the ring [s].
_POLL_PERIOD_S = 1.0


class Follower(Protocol):
    """What a process makes of one service."""

    def add(self, cycles: Sequence[Cycle]) -> None:
        """Use the cycles since the last call, about a second; there may be none."""

    def end(self) -> None:
        """Finish, as the service has ended, or the process ends."""


def follow_services(path: Path | None, begin: Callable[[CycleReader], Follower]) -> None:
    """Follow the services that write a ring, one after the other, until SIGINT or SIGTERM.

    Args:
        path: The ring; None for where it is by default.
        begin: Returns what follows a service, by a reader of its ring; called once for each.
    """
    ends = {signal.SIGINT, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, ends)
    told = ""
    while True:
        try:
            with closing(CycleReader(path)) as reader:
                follower, told = begin(reader), ""
                while reader.is_still_written():
                    follower.add(list(_cycles(reader)))
                    if signal.sigtimedwait(ends, _POLL_PERIOD_S) is not None:
                        follower.end()
                        return
                follower.end()
                reason = "it has ended"
        except FootsenseError as error:
            reason = str(error)
        if reason != told:
            _log.warning("no service: %s", reason)
            told = reason
        if signal.sigtimedwait(ends, _POLL_PERIOD_S) is not None:
            return


def _cycles(reader: CycleReader) -> Iterator[Cycle]:
    while entries := reader.read():
        yield from (entry.cycle for entry in entries if isinstance(entry, NumberedCycle))
