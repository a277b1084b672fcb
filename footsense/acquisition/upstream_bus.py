"""A bus and the mux on it: which legs are connected, what they answer together, and how the bus is freed."""

import contextlib
from collections.abc import Iterable

from firmware_interface import tca9548a
from footsense.acquisition.boards.board import Check
from footsense.errors import BusError
from footsense.ports import I2cBus, ResetLine, Transaction


class Trunk:
    """The adapter with its TCA9548A; remembers the selection, so that it is not written twice.

    Args:
        bus: The adapter.
        mux_address: Address of the mux.
        reset_line: The mux's RESET pin; None if nothing drives it.
    """

    def __init__(self, bus: I2cBus, mux_address: int, reset_line: ResetLine | None = None) -> None:
        self.bus = bus
        self.mux_address = mux_address
        self._reset_line = reset_line
        self._connected: int | None = None

    def connect(self, channels: Iterable[int]) -> None:
        """Connect these channels and no others.

        Raises:
            BusError: The mux did not take it; what is connected is then unknown.
        """
        selection = tca9548a.select(tuple(channels))
        if selection == self._connected:
            return
        self._connected = None
        self.bus.transfer(Transaction(self.mux_address, bytes((selection,))))
        self._connected = selection

    def is_connected(self, channels: Iterable[int]) -> bool:
        """Tell whether exactly these channels are connected for certain."""
        return self._connected == tca9548a.select(tuple(channels))

    def doubt(self) -> None:
        """Forget what is connected: the mux may have lost it."""
        self._connected = None

    def free(self) -> bool:
        """Disconnect every leg from a bus whose lines may be held, and tell whether the mux answers again.

        A leg that holds SDA low blocks the write that would disconnect it, so that only the RESET pin helps. Without
        one, that write is tried all the same: what held the line may have let go.
        """
        self._connected = None
        if self._reset_line is not None:
            self._reset_line.pulse()
        with contextlib.suppress(BusError):
            self.connect(())
        return self._connected is not None

    def holds(self, channels: Iterable[int], check: Check) -> bool:
        """Tell whether every leg on these channels answers as it should.

        Raises:
            BusError: The question was not answered.
        """
        self.connect(channels)
        return self.bus.transfer(check.ask) == check.expected
