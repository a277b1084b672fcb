"""The simulated robot: feet, chips, buses and time, put together for a scene.

A foot is pressed by the scene's load; the response table turns contact into gap closures, those into capacitances;
the row switch decides which of them a converter pin sees.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.sim.bus.i2c_bus import SimulatedBus, SimulatedMux
from footsense.sim.bus.kernel_mux import SimulatedKernelMuxLeg
from footsense.sim.chips.electronics import Wired, electronics
from footsense.sim.clock import JoinedClock, VirtualClock
from footsense.sim.faults.bus_faults import FailingBus
from footsense.sim.faults.chip_faults import failing_chips
from footsense.sim.faults.damage import Damage
from footsense.sim.faults.scene_faults import OnChips, OnFoot, OnWires, StuckSda
from footsense.sim.foot.fabrication import fabricate, mounted
from footsense.sim.foot.viscoelastic import RememberingRubber
from footsense.sim.foot.warming import WarmingFoot, softness_at
from footsense.sim.loads.gait_table import GaitTable
from footsense.sim.loads.ground_load import Load, Walk
from footsense.sim.scene import Scene


class Wiring(NamedTuple):
    """One simulated bus.

    Attributes:
        rate_hz: Its clock [Hz].
        mux_address: Address of its mux.
        channels: Mux channel of each leg.
        kernel_mux: Whether the kernel drives the mux, and each leg is an adapter of its own.
        board: Electronics of its legs: `fdc1004` or `ad7746`.
    """

    rate_hz: int
    mux_address: int
    channels: dict[str, int]
    kernel_mux: bool = False
    board: str = "fdc1004"


class SimulatedLeg:
    """The electronics of one leg and the foot that it reads.

    Args:
        leg: Name of the leg.
        number: Its place among the legs, which seeds its noise.
        scene: What the robot does.
        load: The scene's load.
        foot: The foot on it.
        table: What its foot does over a gait cycle; None to ask the response each time.
        board: Its electronics: `fdc1004` or `ad7746`.

    Attributes:
        chips: Its chips, as its bus sees them.
        wired: What these are wired to.
    """

    def __init__(
        self,
        leg: str,
        number: int,
        scene: Scene,
        load: Load,
        foot: Foot,
        table: GaitTable | None = None,
        board: str = "fdc1004",
    ) -> None:
        effects = scene.effects
        self._leg = leg
        self._load = load
        self._table = table
        self._foot = foot
        self._rubber = RememberingRubber() if effects.rubber else None
        self._pressed: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
        self._pressed_pf: list[float] = foot.rest_pf.tolist()
        # What breaks draws from elsewhere, so that the same converters make the same noise.
        own = [fault for fault in scene.faults if getattr(fault, "leg", None) == leg]
        on_chips = [fault for fault in own if isinstance(fault, OnChips)]
        on_foot = [fault for fault in own if isinstance(fault, OnFoot)]
        self._damage = Damage(on_foot, self._foot) if on_foot else None
        self.wired = Wired(self._elements_pf, self._damage)
        converter, switches = electronics(board, self.wired, effects, (scene.seed, number))
        self.chips = failing_chips(
            converter, switches, on_chips, np.random.default_rng((scene.seed, number, 1))
        )
        softening = effects.softening
        self._softening = softening if softening is not None and softening.leg == leg else None
        self._warming = (
            WarmingFoot(effects.warming, np.random.default_rng((scene.seed, number, 2)))
            if effects.warming
            else None
        )

    def _elements_pf(self, t_ns: int) -> list[float]:
        """Return the capacitance of the foot's elements at a time [pF], nine, stray not included."""
        softness = 1.0 if self._warming is None else self._warming.softness(t_ns)
        if self._softening is not None:
            softness *= self._softening.softness(t_ns)
        if self._table is not None and isinstance(self._load, Walk):
            element_pf = self._table.capacitance_pf(self._load.phase(self._leg, t_ns), softness)
        else:
            contact = self._load.contact(self._leg, t_ns)
            normal, force_n = contact
            if self._rubber is not None:
                normal, force_n = self._rubber.felt(t_ns, normal, force_n)
            # A solid that is stiffer yields as if it were loaded less.
            element_pf = self._solid_pf(normal, force_n if softness == 1.0 else force_n * softness)
        if self._warming is not None:
            drift_pf = self._warming.drift_pf(t_ns)
            element_pf = [pf + by_pf for pf, by_pf in zip(element_pf, drift_pf, strict=True)]
        if self._damage is not None:
            element_pf = self._damage.elements_pf(element_pf, t_ns)
        return element_pf

    def _solid_pf(self, normal: NDArray[np.float64], force_n: NDArray[np.float64]) -> list[float]:
        """Return the capacitances of a load [pF], nine; a load that stands still is computed once."""
        if self._pressed is None or not (
            np.array_equal(force_n, self._pressed[1]) and np.array_equal(normal, self._pressed[0])
        ):
            self._pressed = normal, force_n
            self._pressed_pf = self._foot.capacitance_pf(normal[None], force_n[None])[0].tolist()
        return self._pressed_pf


def _feet(scene: Scene, response: FootResponse, legs: Sequence[str]) -> dict[str, Foot]:
    """Return the foot on each leg: as designed, one for all; as made, each its own."""
    made, contact = scene.fabrication, scene.effects.gap_contact
    if made is None:
        return dict.fromkeys(legs, Foot(response, contact=contact))
    feet = {}
    for number, leg in enumerate(legs, made.first):
        own = fabricate(response, made.tolerances, made.seed, number)
        own = mounted(own, made.remount_deg, made.seed, number, made.mounting)
        feet[leg] = Foot(response, own, contact=contact)
    return feet


def _gait_tables(scene: Scene, load: Load, feet: dict[str, Foot]) -> dict[str, GaitTable]:
    """Return the table of each leg; those with the same foot and load share one."""
    if not isinstance(load, Walk):
        return {}
    warming = scene.effects.warming
    warmed = 1.0 if warming is None else softness_at(warming.kelvin)
    softening = scene.effects.softening
    softened = 1.0 if softening is None else 1.0 + softening.softer_rel
    bounds = (1.0, warmed, softened, warmed * softened)
    softness = (min(bounds), max(bounds))
    one_of = {(foot, load.reaction[leg]): leg for leg, foot in feet.items()}
    tables = {which: GaitTable(which[0], load, leg, softness) for which, leg in one_of.items()}
    return {leg: tables[foot, load.reaction[leg]] for leg, foot in feet.items()}


class SimulatedRobot:
    """A robot in a scene.

    Args:
        scene: What it does.
        response: How its feet yield.
        buses: Its wiring.

    Attributes:
        clocks: The time of each bus.
        clock: The time of whoever uses all buses together.
        buses: The trunks: the adapters, unless the kernel drives the mux.
        adapters: Adapter of each leg by name, for every bus whose mux the kernel drives; empty for the others.
        muxes: The mux of each, whose RESET pin a line of the host may drive.
        response_sha256: Hash of the table that its feet follow.
        feet: The foot on each leg.
        legs: The legs by name.
    """

    def __init__(self, scene: Scene, response: FootResponse, buses: Sequence[Wiring]) -> None:
        self._load = scene.load.build(round(scene.lead_in_s * 1e9))
        self.response_sha256 = response.sha256
        self._legs = tuple(leg for wiring in buses for leg in wiring.channels)
        self.feet = _feet(scene, response, self._legs)
        tables = _gait_tables(scene, self._load, self.feet) if scene.gait_table else {}
        self.legs: dict[str, SimulatedLeg] = {}
        self.clocks = tuple(VirtualClock() for _ in buses)
        self.clock = JoinedClock(self.clocks)
        self.buses: list[SimulatedBus | FailingBus] = []
        self.muxes: list[SimulatedMux] = []
        self.adapters: list[dict[str, SimulatedKernelMuxLeg]] = []
        for number, (wiring, clock) in enumerate(zip(buses, self.clocks, strict=True)):
            for leg in wiring.channels:
                self.legs[leg] = SimulatedLeg(
                    leg,
                    self._legs.index(leg),
                    scene,
                    self._load,
                    self.feet[leg],
                    tables.get(leg),
                    wiring.board,
                )
            mux = SimulatedMux(wiring.mux_address)
            # A mux that the kernel drives is switched without a system call: there each leg brings the host's cost.
            leg_cost_ns = round(scene.host_cost_us * 1e3)
            host_cost_ns = 0 if wiring.kernel_mux else leg_cost_ns
            bus: SimulatedBus | FailingBus = SimulatedBus(
                clock,
                rate_hz=wiring.rate_hz,
                host_cost_ns=host_cost_ns,
                mux=mux,
                legs={channel: self.legs[leg].chips for leg, channel in wiring.channels.items()},
            )
            broken = [
                fault
                for fault in scene.faults
                if isinstance(fault, OnWires)
                and (fault.leg in wiring.channels if isinstance(fault, StuckSda) else fault.bus == number)
            ]
            if broken:
                bus = FailingBus(
                    bus,
                    clock,
                    mux,
                    wiring.channels,
                    broken,
                    timeout_ns=round(scene.effects.adapter_timeout_ms * 1e6),
                    host_cost_ns=host_cost_ns,
                    rng=np.random.default_rng((scene.seed, number, 3)),
                )
            self.buses.append(bus)
            self.muxes.append(mux)
            self.adapters.append(
                {
                    leg: SimulatedKernelMuxLeg(bus, clock, mux, channel, leg_cost_ns)
                    for leg, channel in wiring.channels.items()
                    if wiring.kernel_mux
                }
            )

    def true_force_n(self, t_ns: int) -> NDArray[np.float64]:
        """Return the force that every foot really feels at a time [N], shape (legs, 3), foot frame."""
        return np.array([self._load.contact(leg, t_ns).force_n for leg in self._legs])
