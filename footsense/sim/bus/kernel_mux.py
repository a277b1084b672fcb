"""The adapter of a leg behind a mux that the kernel drives: it selects its channel where another one was used."""

from firmware_interface.chips import tca9548a
from footsense.ports import I2cBus, Transaction
from footsense.sim.chips.mux import SimulatedMux
from footsense.sim.clock import VirtualClock


class SimulatedKernelMuxLeg:
    """One mux channel of an upstream bus, presented as a separate adapter.

    A selection costs bits on the wire and no system call: the upstream bus has no host cost here, and each transaction
    adds its own.

    Args:
        upstream: The upstream bus, made without a host cost.
        clock: Clock of the upstream bus.
        mux: The mux on the upstream bus.
        channel: Channel of the leg.
        host_cost_ns: Cost of a transaction on the host [ns].
    """

    def __init__(
        self, upstream: I2cBus, clock: VirtualClock, mux: SimulatedMux, channel: int, host_cost_ns: int
    ) -> None:
        self._upstream = upstream
        self._clock = clock
        self._mux = mux
        self._selection = tca9548a.select(channel)
        self._host_cost_ns = host_cost_ns

    def transfer(self, transaction: Transaction) -> bytes:
        """Select the channel where it is not selected, then do the transaction.

        Raises:
            BusError: As the upstream bus.
        """
        self._clock.advance_ns(self._host_cost_ns)
        if self._mux.control != self._selection:
            self._upstream.transfer(Transaction(self._mux.address, bytes((self._selection,))))
        return self._upstream.transfer(transaction)
