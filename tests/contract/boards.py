"""Legs of either board with given capacitances, the buses that they are on, and the scanner that reads them."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_interface.chips import adg715
from footsense.acquisition.boards.board import CONVERTED
from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.scan_plan import scan_plan
from footsense.acquisition.scanner import BusScanner, RobotScanner
from footsense.errors import I2cError, I2cTimeoutError
from footsense.frames import ELEMENTS, CapFrame, Reading
from footsense.ports import Transaction
from footsense.sim.chips.ad7746 import MeanMutualCapacitance, SimulatedAd7746
from footsense.sim.chips.chip import SimulatedLineSwitch, SimulatedMux
from footsense.sim.chips.fdc1004 import MeanCinCapacitance, SimulatedFdc1004
from footsense.sim.clock import JoinedClock, VirtualClock
from footsense.sim.i2c_bus import SimulatedBus

TIMEOUT_NS = 20_000_000
#: A different capacitance for every element, so that a swap shows [pF].
DISTINCT_PF = 5.0 + 0.125 * np.arange(9)

Capacitance = Callable[[int, int], float]  # element, t_ns -> pF


class Board(NamedTuple):
    """What a test has to know of a board.

    Attributes:
        name: Its name.
        rates_sps: Its conversion rates, the fastest first.
        conversion_ns: A conversion at the fastest [ns].
        exact_pf: How far a reading may be off [pF]: two codes, one of them of the measured CAPDAC.
        probe_ns: What a try of a leg that does not finish its conversions costs the others [ns].
    """

    name: str
    rates_sps: tuple[int, ...]
    conversion_ns: int
    exact_pf: float
    probe_ns: int


FDC1004 = Board("fdc1004", (400, 200, 100), 2_500_000, 0.0, 7_000_000)
AD7746 = Board("ad7746", (91, 84, 50, 26, 16, 13, 11, 9), 11_000_000, 2e-6, 15_000_000)
BOTH = (FDC1004, AD7746)
both = pytest.mark.parametrize("board", BOTH, ids=lambda board: board.name)


def distinct(element: int, t_ns: int) -> float:
    del t_ns
    return float(DISTINCT_PF[element])


def column_through(switch: SimulatedLineSwitch, capacitance_pf: Capacitance) -> MeanCinCapacitance:
    """Return what a pin sees of its column through the rows that the switch grounds."""

    def seen_pf(cin: int, t_start_ns: int, t_end_ns: int) -> float:
        return sum(
            share * capacitance_pf(3 * row + cin, (t_start_ns + t_end_ns) // 2)
            for share, rows in switch.states_between(t_start_ns, t_end_ns)
            for row in range(3)
            if rows.selected_mask >> row & 1
        )

    return seen_pf


def crossing_through(
    rows: SimulatedLineSwitch, columns: SimulatedLineSwitch, capacitance_pf: Capacitance
) -> MeanMutualCapacitance:
    """Return what an input sees of the excited rows through the columns that are switched to it."""

    def seen(t_start_ns: int, t_end_ns: int) -> tuple[float, bool]:
        t_middle_ns, total_pf, until_ns = (t_start_ns + t_end_ns) // 2, 0.0, t_end_ns
        for row_share, row_states in rows.states_between(t_start_ns, t_end_ns):
            since_ns = max(row_states.since_ns, t_start_ns)
            for share, column_states in columns.states_between(since_ns, until_ns):
                for row, column in ((r, c) for r in range(3) for c in range(3)):
                    if row_states.selected_mask >> row & column_states.selected_mask >> column & 1:
                        total_pf += row_share * share * capacitance_pf(3 * row + column, t_middle_ns)
            until_ns = since_ns
        return total_pf, False

    return seen


def _more_at_a_pin(seen_pf: MeanCinCapacitance, added_pf: float) -> MeanCinCapacitance:
    return lambda cin, t_start_ns, t_end_ns: seen_pf(cin, t_start_ns, t_end_ns) + added_pf


def _more_mutual(seen: MeanMutualCapacitance, added_pf: float) -> MeanMutualCapacitance:
    def more(t_start_ns: int, t_end_ns: int) -> tuple[float, bool]:
        pf, shorted = seen(t_start_ns, t_end_ns)
        return pf + added_pf, shorted

    return more


def leg_chips(
    board: Board, capacitance_pf: Capacitance, channel: int, clock_error_rel: float = 0.0
) -> tuple[SimulatedFdc1004 | SimulatedAd7746, list[SimulatedLineSwitch]]:
    """Return converter and line switches of a leg; the CAPDAC's steps are of a size that is each chip's own."""
    rows, columns = SimulatedLineSwitch(), SimulatedLineSwitch(adg715.COLUMN_ADDRESS)
    if board is FDC1004:
        seen_pf = column_through(rows, capacitance_pf)
        return SimulatedFdc1004(seen_pf, None, clock_error_rel), [rows]
    seen = crossing_through(rows, columns, capacitance_pf)
    return SimulatedAd7746(seen, None, clock_error_rel, 0.85 + 0.07 * channel), [rows, columns]


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
        board: Board = FDC1004,
        *,
        n_buses: int = 1,
        host_cost_ns: int = 0,
        rate_sps: int | None = None,
        clock_error_rel: float = 0.0,
    ) -> None:
        self.converters: list[SimulatedFdc1004 | SimulatedAd7746] = []
        self.switches: list[list[SimulatedLineSwitch]] = []
        self.saboteurs: list[Saboteur] = []
        clocks = [VirtualClock() for _ in range(n_buses)]
        scanners: list[BusScanner] = []
        per_bus = 6 // n_buses
        for clock in clocks:
            legs = {}
            for channel in range(per_bus):
                converter, switches = leg_chips(board, capacitance_pf, channel, clock_error_rel)
                self.converters.append(converter)
                self.switches.append(switches)
                legs[channel] = (converter, *switches)
            bus = Saboteur(SimulatedBus(clock, 400_000, host_cost_ns, SimulatedMux(0x71), legs), clock)
            self.saboteurs.append(bus)
            channels = {f"{len(scanners)}{n}": n for n in range(per_bus)}
            scanners.append(
                BusScanner(
                    LegBus(bus, 0x71),
                    clock,
                    channels,
                    scan_plan(rate_sps or board.rates_sps[0], board.name),
                )
            )
        self.board = board
        self._of_leg_pf = np.zeros((6, 1))
        self.clock = JoinedClock(clocks, scanners[0].plan.conversion_wait_ns)
        self.buses = scanners
        self.scanner = RobotScanner(scanners)
        self.scanner.start()

    def make_legs_distinct(self) -> None:
        """Add capacitance to every element of a leg that only that leg has."""
        self._of_leg_pf = np.arange(6)[:, None] / 512
        for converter, added_pf in zip(self.converters, self._of_leg_pf[:, 0].tolist(), strict=True):
            if isinstance(converter, SimulatedFdc1004):
                converter._cin_capacitance_pf = _more_at_a_pin(converter._cin_capacitance_pf, added_pf)
            else:
                converter._mutual_capacitance = _more_mutual(converter._mutual_capacitance, added_pf)

    def chips(self, leg: int) -> list[SimulatedFdc1004 | SimulatedAd7746 | SimulatedLineSwitch]:
        return [self.converters[leg], *self.switches[leg]]

    def is_right(self, frame: CapFrame) -> NDArray[np.bool_]:
        """Tell which readings are their own capacitances."""
        right: NDArray[np.bool_] = (
            np.abs(frame.capacitance_pf - DISTINCT_PF - self._of_leg_pf) <= self.board.exact_pf
        )
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
        """Return what a scan takes; the temperature is taken before those that are timed."""
        self.read(2)
        start_ns = self.clock.now_ns()
        self.read(n)
        return (self.clock.now_ns() - start_ns) / n
