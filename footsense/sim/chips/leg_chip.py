"""Presence and supply of a chip behind a leg's channel of the mux."""

from abc import ABC, abstractmethod

from footsense.sim.faults.schedule import Span, in_any_span


class LegChip(ABC):
    """A chip that answers as long as its leg is connected and supplied.

    Args:
        address: Address on the bus.

    Attributes:
        address: As given.
        absent_ns: Spans in which it does not answer [ns].
        brown_outs_ns: Times of supply dips, each of which resets it [ns].
    """

    def __init__(self, address: int) -> None:
        self.address = address
        self.absent_ns: list[Span] = []
        self.brown_outs_ns: list[float] = []

    def acknowledges(self, t_ns: int) -> bool:
        """Return whether the chip answers at a time [ns], after the supply dips that are over by then."""
        if not (self.brown_outs_ns or self.absent_ns):
            return True
        while self.brown_outs_ns and (dip_ns := min(self.brown_outs_ns)) <= t_ns:
            self.brown_outs_ns.remove(dip_ns)
            self.power_up(round(dip_ns))
        return not in_any_span(self.absent_ns, t_ns)

    @abstractmethod
    def power_up(self, t_ns: int) -> None:
        """Reset the chip to its power-up state at a time [ns]."""
