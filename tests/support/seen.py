"""An observer that keeps every cycle of a service."""

from footsense.frames import Cycle


class Seen:
    """Keeps cycles.

    Attributes:
        cycles: All so far.
    """

    def __init__(self) -> None:
        self.cycles: list[Cycle] = []

    def observe(self, cycle: Cycle) -> None:
        self.cycles.append(cycle)

    def close(self) -> None: ...
