"""A simulated chip as its bus sees it, and behind a leg's channel of the mux: presence and supply."""

from abc import ABC, abstractmethod
from typing import Protocol

from footsense.sim.faults.schedule import Span, in_any_span


class SimulatedChip(Protocol):
    """A chip on the bus; times are the end of the transaction's last clock [ns]."""

    address: int

    def acknowledges(self, t_ns: int) -> bool:
        """Return whether the chip acknowledges its address."""
        ...

    def write(self, data: bytes, t_ns: int) -> None:
        """Receive the bytes of a write."""
        ...

    def read(self, n: int, t_ns: int) -> bytes:
        """Return the next `n` bytes."""
        ...


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
