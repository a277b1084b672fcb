"""A bus and the mux on it: which legs are connected, and what they answer together."""

from collections.abc import Iterable

from firmware_interface import tca9548a
from footsense.drivers.scan_plan import Check
from footsense.ports import I2cBus, Transaction


class Trunk:
    """The adapter with its TCA9548A; remembers the selection, so that it is not written twice.

    Args:
        bus: The adapter.
        mux_address: Address of the mux.
    """

    def __init__(self, bus: I2cBus, mux_address: int) -> None:
        self.bus = bus
        self.mux_address = mux_address
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

    def holds(self, channels: Iterable[int], check: Check) -> bool:
        """Tell whether every leg on these channels answers as it should.

        Raises:
            BusError: The question was not answered.
        """
        self.connect(channels)
        return self.bus.transfer(check.ask) == check.expected
