"""A simulated chip, as its bus sees it."""

from typing import Protocol


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
