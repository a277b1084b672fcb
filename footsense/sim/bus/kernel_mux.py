"""A leg's adapter as the kernel's mux driver gives it: it selects the channel by itself, when another one was used."""

from firmware_interface import tca9548a
from footsense.ports import I2cBus, Transaction
from footsense.sim.bus.i2c_bus import SimulatedMux
from footsense.sim.clock import VirtualClock


class SimulatedKernelMuxLeg:
    """One channel of a trunk as an adapter of its own.

    The selection costs its bits on the wire, but the host no system call: so the trunk has no host cost here, and
    each transaction brings its own.

    Args:
        trunk: The bus behind it, made without a host cost.
        clock: The trunk's time.
        mux: The mux on the trunk.
        channel: The leg's.
        host_cost_ns: What the host adds to a transaction [ns].
    """

    def __init__(
        self, trunk: I2cBus, clock: VirtualClock, mux: SimulatedMux, channel: int, host_cost_ns: int
    ) -> None:
        self._trunk = trunk
        self._clock = clock
        self._mux = mux
        self._selection = tca9548a.select(channel)
        self._host_cost_ns = host_cost_ns

    def transfer(self, transaction: Transaction) -> bytes:
        """Select the channel if it is not, then do the transaction.

        Raises:
            BusError: As the trunk.
        """
        self._clock.advance_ns(self._host_cost_ns)
        if self._mux.control != self._selection:
            self._trunk.transfer(Transaction(self._mux.address, bytes((self._selection,))))
        return self._trunk.transfer(transaction)

    def close(self) -> None:
        """Nothing is held."""
