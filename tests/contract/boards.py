"""Legs of board `fdc1004` with given capacitances, the buses that they are on, and the scanner that reads them."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from footsense.acquisition.boards.board import CONVERTED
from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.robot_scanner import RobotScanner
from footsense.acquisition.scan_plan import scan_plan
from footsense.acquisition.scanner import BusScanner
from footsense.daemon.foot_types import released_path
from footsense.errors import I2cError, I2cTimeoutError
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import ELEMENTS, CapFrame, Reading
from footsense.ports import Transaction
from footsense.sim.chips.chip import SimulatedLineSwitch, SimulatedMux
from footsense.sim.chips.electronics import leg_electronics
from footsense.sim.clock import JoinedClock, VirtualClock
from footsense.sim.faults.chip_faults import LegConverter, inject_chip_faults
from footsense.sim.faults.damage import WiredFoot
from footsense.sim.faults.scene_faults import ChipFault
from footsense.sim.i2c_bus import SimulatedBus
from footsense.sim.scene import Effects

TIMEOUT_NS = 20_000_000
_NO_EFFECTS = Effects()
#: A different capacitance for every element, so that a swap shows [pF].
DISTINCT_PF = 5.0 + 0.125 * np.arange(9)

Capacitance = Callable[[int, int], float]  # element, t_ns -> pF


#: A conversion at the fastest rate, and what a try of a leg that does not finish its conversions costs the others [ns].
CONVERSION_NS, PROBE_NS = 2_500_000, 7_000_000


def distinct(element: int, t_ns: int) -> float:
    del t_ns
    return float(DISTINCT_PF[element])


@cache
def _designed_foot() -> Specimen:
    return Specimen(FootResponse.load(released_path("response.npz")))


class LateError(I2cError):
    """A transaction that took effect before it failed: only the adapter did not hear of it."""


class Saboteur:
    """A bus on which chosen transactions fail.

    Attributes:
        clock: Its time.
        fails: Tells from a transaction and its number since the last arming how it fails; None for not at all.
    """

    def __init__(self, bus: SimulatedBus, clock: VirtualClock) -> None:
        self._bus = bus
        self.clock = clock
        self._n = 0
        self.fails: Callable[[Transaction, int], I2cError | None] = lambda transaction, n: None

    def arm(self, fails: Callable[[Transaction, int], I2cError | None]) -> None:
        self.fails, self._n = fails, 0

    def transfer(self, transaction: Transaction) -> bytes:
        error = self.fails(transaction, self._n)
        self._n += 1
        if error is None:
            return self._bus.transfer(transaction)
        if isinstance(error, LateError):
            self._bus.transfer(transaction)
        self.clock.advance_ns(TIMEOUT_NS if isinstance(error, I2cTimeoutError) else 27_500)
        raise error


def only(n_failing: int, error: I2cError) -> Callable[[Transaction, int], I2cError | None]:
    """Return a sabotage of one transaction."""
    return lambda transaction, n: error if n == n_failing else None


class Robot:
    """Legs with given capacitances on one or more buses, and their scanner."""

    def __init__(
        self,
        capacitance_pf: Capacitance,
        *,
        n_buses: int = 1,
        host_cost_ns: int = 0,
        rate_sps: int = 400,
        clock_error_rel: float = 0.0,
        effects: Effects = _NO_EFFECTS,
        faults: Sequence[tuple[int, ChipFault]] = (),
    ) -> None:
        self.converters: list[LegConverter] = []
        self.switches: list[SimulatedLineSwitch] = []
        self.muxes: list[SimulatedMux] = []
        self.saboteurs: list[Saboteur] = []
        self._of_leg_pf = np.zeros((6, 1))
        clocks = [VirtualClock() for _ in range(n_buses)]
        scanners: list[BusScanner] = []
        per_bus = 6 // n_buses
        for clock in clocks:
            legs = {}
            for channel in range(per_bus):
                leg = len(self.converters)

                def element_pf(t_ns: int, leg: int = leg) -> list[float]:
                    return [capacitance_pf(e, t_ns) + self._of_leg_pf[leg, 0] for e in range(ELEMENTS)]

                foot = WiredFoot(element_pf, (), _designed_foot())
                converter, switch = leg_electronics("fdc1004", foot, effects, (0, leg))
                assert switch is not None
                converter.clock_factor += clock_error_rel
                self.converters.append(converter)
                self.switches.append(switch)
                own = [fault for of_leg, fault in faults if of_leg == leg]
                legs[channel] = inject_chip_faults(converter, switch, own, np.random.default_rng(1))
            self.muxes.append(SimulatedMux(0x71))
            bus = Saboteur(SimulatedBus(clock, 400_000, host_cost_ns, self.muxes[-1], legs), clock)
            self.saboteurs.append(bus)
            channels = {f"{len(scanners)}{n}": n for n in range(per_bus)}
            scanners.append(BusScanner(LegBus(bus, 0x71), clock, channels, scan_plan(rate_sps)))
        self.clock = JoinedClock(clocks, scanners[0].plan.conversion_wait_ns)
        self.buses = scanners
        self.scanner = RobotScanner(scanners)
        self.scanner.start()

    def make_legs_distinct(self) -> None:
        """Add capacitance to every element of a leg that only that leg has."""
        self._of_leg_pf = np.arange(6)[:, None] / 512

    def chips(self, leg: int) -> list[LegConverter | SimulatedLineSwitch]:
        return [self.converters[leg], self.switches[leg]]

    def is_right(self, frame: CapFrame) -> NDArray[np.bool_]:
        """Tell which readings are their own capacitances."""
        right: NDArray[np.bool_] = frame.capacitance_pf == DISTINCT_PF + self._of_leg_pf
        return right

    def assert_honest(self, frame: CapFrame) -> None:
        """Make sure that every reading is right, or says that it is none."""
        ok = frame.reading == Reading.OK
        assert self.is_right(frame)[ok].all()
        assert np.isnan(frame.capacitance_pf[~ok]).all()
        assert ((frame.t_ns > 0) == np.isin(frame.reading, list(CONVERTED))).all()

    def convert(self) -> CapFrame:
        frame = self.scanner.read()
        self.clock.now_ns()
        return frame

    def read(self, n: int = 1) -> CapFrame:
        """Return the frame that completes a scan, the last of `n` scans."""
        for _ in range(n):
            while (frame := self.convert()).sequence % ELEMENTS:
                pass
        return frame

    def period_ns(self, n: int = 20) -> float:
        """Return what a scan takes."""
        self.read(2)
        start_ns = self.clock.now_ns()
        self.read(n)
        return (self.clock.now_ns() - start_ns) / n
