"""A simulated bus on whose wires something breaks.

A leg that holds SDA low reaches the trunk through its channel of the mux, which is a switch and no buffer: from then
on no transaction gets through, not even the one that would disconnect the leg. Only the mux's RESET pin frees the
trunk, as its data sheet says (TCA9548A, 8.4.1). Each transaction costs the adapter's timeout.

A transaction that loses arbitration is begun again by the kernel as often as the adapter's `retries` say.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from footsense.errors import BusError, BusTimeoutError
from footsense.ports import I2cBus, Transaction
from footsense.sim.bus import SimulatedMux
from footsense.sim.clock import VirtualClock
from footsense.sim.faults import ArbitrationLost, MuxLost, OnWires, Span, StuckSda, StuckTrunk, during

#: What `footsense/backends/linux_i2c.py` asks the kernel for.
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
        self._trunk_held: list[Span] = []
        self._leg_holds: list[tuple[int, Span]] = []
        self._contended: list[tuple[Span, float]] = []
        self._forgets_ns: list[int] = []
        for fault in faults:
            match fault:
                case StuckSda(leg=leg, span_ns=span_ns):
                    self._leg_holds.append((1 << channels[leg], span_ns))
                case StuckTrunk(span_ns=span_ns):
                    self._trunk_held.append(span_ns)
                case ArbitrationLost(span_ns=span_ns, rate_rel=rate_rel):
                    self._contended.append((span_ns, rate_rel))
                case MuxLost(at_ns=at_ns):
                    self._forgets_ns.append(at_ns)

    def transfer(self, transaction: Transaction) -> bytes:
        """Do one transaction, if the wires let it through.

        Raises:
            BusTimeoutError: SDA is held low.
            BusError: Arbitration was lost more often than the kernel begins again.
        """
        t_ns = self._clock.now_ns()
        while self._forgets_ns and min(self._forgets_ns) <= t_ns:
            self._forgets_ns.remove(min(self._forgets_ns))
            self._mux.control = 0
        if self._is_held(t_ns):
            self._clock.advance_ns(self._host_cost_ns + self._timeout_ns)
            raise BusTimeoutError("timeout, SDA or SCL is held low")
        for _ in range(1 + KERNEL_RETRIES):
            if not self._loses(t_ns):
                return self._bus.transfer(transaction)
            self._clock.advance_ns(self._host_cost_ns + _LOST_AFTER_NS)
        raise BusError("arbitration lost: another master is on this bus")

    def close(self) -> None:
        """Close the bus."""
        self._bus.close()

    def _is_held(self, t_ns: int) -> bool:
        return during(self._trunk_held, t_ns) or any(
            self._mux.control & channel and during([span_ns], t_ns) for channel, span_ns in self._leg_holds
        )

    def _loses(self, t_ns: int) -> bool:
        return any(
            during([span_ns], t_ns) and self._rng.random() < rate_rel for span_ns, rate_rel in self._contended
        )
