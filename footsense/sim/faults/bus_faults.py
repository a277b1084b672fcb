"""A simulated bus on whose wires something breaks.

A leg that holds SDA low reaches the trunk through its channel of the mux, which is a switch and no buffer: from then
on no transaction gets through, not even the one that would disconnect the leg. Only the mux's RESET pin frees the
trunk, as its data sheet says (TCA9548A, 8.4.1). Each transaction costs the adapter's timeout.

A transaction that loses arbitration is begun again by the kernel as often as the adapter's `retries` say.
"""

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from footsense.errors import BusError, BusTimeoutError
from footsense.ports import I2cBus, Transaction
from footsense.sim.bus.i2c_bus import SimulatedMux
from footsense.sim.clock import VirtualClock
from footsense.sim.faults.scene_faults import ArbitrationLost, MuxReset, OnWires, StuckSda, StuckUpstreamBus
from footsense.sim.faults.schedule import Schedule

#: What `footsense/acquisition/linux_i2c.py` asks the kernel for.
KERNEL_RETRIES = 1
#: How far into its transaction an adapter gets before it loses arbitration: the address, at 400 kHz [ns].
_LOST_AFTER_NS = 25_000


class FailingBus:
    """Stands in front of a simulated bus.

    Args:
        bus: The bus as it would be.
        clock: Its time.
        mux: The mux on its trunk.
        channels: Mux channel of each leg.
        faults: What breaks.
        timeout_ns: How long the adapter waits for a line that is held [ns].
        host_cost_ns: What the host adds to every transaction [ns].
        rng: Of what happens at random.
    """

    def __init__(
        self,
        bus: I2cBus,
        clock: VirtualClock,
        mux: SimulatedMux,
        channels: Mapping[str, int],
        faults: Sequence[OnWires],
        timeout_ns: int,
        host_cost_ns: int,
        rng: np.random.Generator,
    ) -> None:
        self._bus = bus
        self._clock = clock
        self._mux = mux
        self._timeout_ns = timeout_ns
        self._host_cost_ns = host_cost_ns
        self._rng = rng
        self._channels = dict(channels)
        self._faults = Schedule((fault.span_ns, fault) for fault in faults if not isinstance(fault, MuxReset))
        self._forgets_ns = deque(sorted(fault.at_ns for fault in faults if isinstance(fault, MuxReset)))

    def transfer(self, transaction: Transaction) -> bytes:
        """Do one transaction, if the wires let it through.

        Raises:
            BusTimeoutError: SDA is held low.
            BusError: Arbitration was lost more often than the kernel begins again.
        """
        t_ns = self._clock.now_ns()
        while self._forgets_ns and self._forgets_ns[0] <= t_ns:
            self._forgets_ns.popleft()
            self._mux.control = 0
        acting = self._faults.at(t_ns)
        if not acting:
            return self._bus.transfer(transaction)
        if any(self._holds(fault) for fault in acting):
            self._clock.advance_ns(self._host_cost_ns + self._timeout_ns)
            raise BusTimeoutError("timeout, SDA or SCL is held low")
        for _ in range(1 + KERNEL_RETRIES):
            if not any(self._wins(fault) for fault in acting):
                return self._bus.transfer(transaction)
            self._clock.advance_ns(self._host_cost_ns + _LOST_AFTER_NS)
        raise BusError("arbitration lost: another master is on this bus")

    def close(self) -> None:
        """Close the bus."""
        self._bus.close()

    def _holds(self, fault: OnWires) -> bool:
        """Tell whether a fault that acts holds a line of the bus."""
        if isinstance(fault, StuckSda):
            return bool(self._mux.control >> self._channels[fault.leg] & 1)
        return isinstance(fault, StuckUpstreamBus)

    def _wins(self, fault: OnWires) -> bool:
        """Tell whether a fault that acts wins an arbitration this time."""
        return isinstance(fault, ArbitrationLost) and self._rng.random() < fault.rate_rel
