"""Six legs with board `ad7147`, their hosts and buses, whose readings are checked one by one.

The feet are pressed and let go, each element and leg by another capacitance, so that a reading of another conversion,
element or leg shows.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_interface.chips import ad7147 as chip
from firmware_interface.chips.ad7147 import InputConnection
from footsense.acquisition.free_scanner import FreeScanner
from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.mcu_source import McuSource, Serial
from footsense.acquisition.robot_scanner import RobotScanner
from footsense.acquisition.scan_plan import AD7147_PLAN
from footsense.frames import CapFrame, Reading
from footsense.ports import Transaction
from footsense.sim.chips.ad7147 import SimulatedAd7147
from footsense.sim.chips.chip import SimulatedChip, SimulatedMux
from footsense.sim.clock import JoinedClock, VirtualClock
from footsense.sim.faults.chip_faults import inject_chip_faults
from footsense.sim.faults.scene_faults import ChipFault, StuckSda
from footsense.sim.faults.wire_faults import WireFaults
from footsense.sim.i2c_bus import SimulatedBus
from footsense.sim.scene import Ad7147Effects
from tests.contract.boards import TIMEOUT_NS, Saboteur
from tests.firmware.board import BAUD, Board, Line
from tests.firmware.emulated import WANTED, Emulated
from tests.firmware.native import native_scan

MUX, MS_NS, S_NS = 0x71, 1_000_000, 1_000_000_000
N_LEGS = 6
REFERENCE_PF = 4.7
#: Rise of the capacitances in half a period [pF]: 83 fF in a sequence, 9 fF in a stage.
RISE_PF, PERIOD_NS = 6.0, S_NS


def true_pf(leg: NDArray[np.int_], element: NDArray[np.int_], t_ns: NDArray[np.int_]) -> NDArray[np.float64]:
    """Return the capacitance of elements of legs at times [pF]."""
    phase = np.mod(t_ns / PERIOD_NS, 1.0)
    pressed = 1.0 - np.abs(2.0 * phase - 1.0)
    return np.asarray(4.0 + RISE_PF * pressed + 0.04 * element + 0.013 * leg)


class Wiring(NamedTuple):
    """Buses, whether each leg has an address or a channel of its own, and what runs the firmware that scans them."""

    n_buses: int
    has_mux: bool
    boot: Callable[[Board], Callable[[], None]] | None = None

    @property
    def on_mcu(self) -> bool:
        """Return whether a microcontroller scans the legs, each on a bus of its own."""
        return self.boot is not None


MCU, EMULATED = (Wiring(N_LEGS, has_mux=False, boot=boot) for boot in (native_scan, Emulated))
ADDRESSES, CHANNELS, ONE_MUX = Wiring(2, has_mux=False), Wiring(2, has_mux=True), Wiring(1, has_mux=True)
wirings = pytest.mark.parametrize(
    "wiring",
    [
        pytest.param(ADDRESSES, id="addresses"),
        pytest.param(MCU, id="mcu"),
        pytest.param(
            EMULATED, id="emulated", marks=pytest.mark.skipif(not WANTED, reason="by make firmware")
        ),
        pytest.param(CHANNELS, id="channels", marks=pytest.mark.slow),
        pytest.param(ONE_MUX, id="one-mux", marks=pytest.mark.slow),
    ],
)
without_mux = pytest.mark.parametrize("wiring", wirings.args[1][:3])
with_mux = pytest.mark.parametrize(
    "wiring",
    [pytest.param(CHANNELS, id="channels"), pytest.param(ONE_MUX, id="one-mux", marks=pytest.mark.slow)],
)
QUIET = Ad7147Effects(noise_ff=0.0)


class Host(Saboteur):
    """A computer that delays transactions before and behind them, and stalls now and then."""

    jitter_ns = stalls_rel = 0.0

    def transfer(self, transaction: Transaction) -> bytes:
        self._delay()
        answer = super().transfer(transaction)
        self._delay()
        return answer

    def _delay(self) -> None:
        if self.jitter_ns or self.stalls_rel:
            self.clock.advance_ns(round(self.random.uniform(0, self.jitter_ns)))
            if self.random.random() < self.stalls_rel:
                self.clock.advance_ns(round(self.random.exponential(6 * MS_NS)))

    def __init__(self, bus: SimulatedBus, clock: VirtualClock, random: np.random.Generator) -> None:
        super().__init__(bus, clock)
        self.random = random


class Robot:
    """Six legs with an AD7147 each, their buses and scanner."""

    def __init__(
        self,
        wiring: Wiring = ADDRESSES,
        effects: Ad7147Effects = QUIET,
        *,
        host_cost_us: int | None = None,
        jitter_us: float = 0.0,
        stalls_rel: float = 0.0,
        bus_hz: int = 400_000,
        clock_rel: float = 0.04,
        gain_rel: float = 0.25,
        reference_pf: float = REFERENCE_PF,
        faults: Sequence[ChipFault] = (),
        wire_faults: Sequence[StuckSda] = (),
        straps: dict[int, int] | None = None,
        seed: int = 1,
    ) -> None:
        """Faults are of leg 3, `lf` in them; `straps` are the addresses of chips that are not as configured."""
        if host_cost_us is None:  # what the bus carries
            host_cost_us = 0 if wiring.on_mcu else 40 if wiring is ONE_MUX else 100
        timeout_ns = 50_000 if wiring.on_mcu else TIMEOUT_NS  # nine clocks and no more
        random = np.random.default_rng(seed)
        self.noise_ff, self.reference_pf = effects.noise_ff, np.full(N_LEGS, reference_pf)
        self.legs = np.arange(N_LEGS)
        self.chips: list[SimulatedAd7147] = []
        self.muxes: list[SimulatedMux] = []
        self.hosts: list[Host] = []
        self.scanners: list[FreeScanner] = []
        clocks = [VirtualClock() for _ in range(wiring.n_buses)]
        per_bus = N_LEGS // wiring.n_buses
        for clock in clocks:
            behind: dict[int, list[SimulatedChip]] = {}
            channels, addresses = {}, {}
            for n in range(per_bus):
                leg = len(self.chips)
                address = chip.ADDRESSES[0 if wiring.has_mux else n]
                gain, offset, rate = random.choice((-1.0, 0.3, 1.0), 3)
                self.chips.append(
                    SimulatedAd7147(
                        self._input_pf(leg),
                        np.random.default_rng((seed, leg)) if effects.noise_ff else None,
                        clock_rel * rate,
                        address=(straps or {}).get(leg, address),
                        effects=effects,
                        gain_rel=gain_rel * gain,
                        offset_rel=gain_rel * offset,
                        bus_clock_hz=bus_hz,
                        shifts=np.random.default_rng((seed, leg, 1)),
                    )
                )
                own = inject_chip_faults(self.chips[-1], None, faults if leg == 3 else (), random)
                channel = n if wiring.has_mux else 0
                behind.setdefault(channel, []).extend(own)
                channels[f"leg {leg}"], addresses[f"leg {leg}"] = channel, address
            mux = SimulatedMux(MUX) if wiring.has_mux else None
            self.muxes += [mux] if mux else []
            is_broken = wire_faults and 3 in range(len(self.chips) - per_bus, len(self.chips))
            breaks = WireFaults(wire_faults, {"lf": 3 % per_bus if mux else 0}, timeout_ns, random)
            bus = SimulatedBus(clock, bus_hz, 1000 * host_cost_us, mux, behind, breaks if is_broken else None)
            self.hosts.append(Host(bus, clock, random))
            self.hosts[-1].jitter_ns, self.hosts[-1].stalls_rel = 1e3 * jitter_us, stalls_rel
            leg_bus = LegBus(self.hosts[-1], MUX if mux else None, mux)
            self.scanners.append(FreeScanner(leg_bus, clock, channels, addresses, AD7147_PLAN))
        self.clock: JoinedClock | VirtualClock
        self.scanner: RobotScanner | McuSource
        if wiring.boot is not None:
            self.clock, self.board = VirtualClock(), Board(self.hosts, clocks)
            self.line = Line(self.board, wiring.boot, self.clock)
            self.scanner = McuSource(self.line, self.clock, Serial(device="sim", baud=BAUD))
        else:
            self.clock = JoinedClock(clocks, AD7147_PLAN.conversion_wait_ns)
            self.scanner = RobotScanner(self.scanners)
        self.start()

    def start(self) -> None:
        """Start the scanner, or the firmware, and wait for its legs."""
        if isinstance(self.scanner, RobotScanner):
            self.scanner.start()
            return
        self.line.start()
        until_ns = self.clock.now_ns() + round(0.28 * S_NS)
        while self.scanner.read().reading.any() and self.clock.now_ns() < until_ns:
            pass

    def _input_pf(self, leg: int) -> Callable[[int, tuple[InputConnection, ...], int, int], float]:
        def input_pf(cin: int, connections: tuple[InputConnection, ...], from_ns: int, to_ns: int) -> float:
            stray_pf = 0.5 * (chip.N_INPUTS - 1 - connections.count(InputConnection.BIAS))
            if cin == 12:
                return float(self.reference_pf[leg]) + stray_pf
            phase = (from_ns + to_ns) / 2 / PERIOD_NS % 1.0  # as `true_pf`
            found_pf: float = (
                4.0
                + RISE_PF * (1.0 - abs(2.0 * phase - 1.0))
                + 0.04 * cin
                + 0.013 * self.legs[leg]
                + stray_pf
            )
            return found_pf

        return input_pf

    def read(self) -> CapFrame:
        """Return the next frame, after making sure that each of its readings is right, or none."""
        frame = self.scanner.read()
        now_ns = max(host.clock.now_ns() for host in self.hosts)
        self.clock.now_ns()
        is_ok = frame.reading == Reading.OK
        leg, element = np.nonzero(is_ok)
        t_ns = frame.t_ns[is_ok]
        error_ff = 1e3 * np.abs(frame.capacitance_pf[is_ok] - true_pf(self.legs[leg], element, t_ns))
        assert error_ff.max(initial=0.0) < 6.0 + 6.0 * self.noise_ff
        assert ((t_ns > 0) & (t_ns < now_ns)).all()
        assert np.isnan(frame.capacitance_pf[~is_ok]).all()
        return frame

    def read_for(self, s: float) -> list[tuple[int, NDArray[np.uint8], NDArray[np.int64]]]:
        """Return times, readings and stamps of all frames for some time."""
        until_ns, frames = self.clock.now_ns() + s * S_NS, []
        while self.clock.now_ns() < until_ns:
            frame = self.read()
            frames.append((self.clock.now_ns(), frame.reading, frame.t_ns))
        return frames
