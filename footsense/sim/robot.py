"""The simulated robot: feet, chips, buses and clocks of a scene.

The load of the scene presses each foot; the response table turns contacts into gap closures, those into capacitances;
the row switch connects some of them to the pins of the converter.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.sim.bus.i2c_bus import SimulatedBus, SimulatedMux
from footsense.sim.bus.kernel_mux import SimulatedKernelMuxLeg
from footsense.sim.chips.electronics import WiredFoot, electronics
from footsense.sim.clock import JoinedClock, VirtualClock
from footsense.sim.faults.bus_faults import FailingBus
from footsense.sim.faults.chip_faults import failing_chips
from footsense.sim.faults.damage import Damage
from footsense.sim.faults.scene_faults import OnChips, OnFoot, OnWires, StuckSda
from footsense.sim.foot.fabrication import fabricate, mounted
from footsense.sim.foot.viscoelastic import ViscoelasticElement
from footsense.sim.foot.warming import WarmingFoot, softness_at
from footsense.sim.loads.gait_table import GaitTable
from footsense.sim.loads.ground_load import ContactSource, GroundContact, Walk
from footsense.sim.scene import Scene


class Wiring(NamedTuple):
    """Wiring of one simulated bus: clock, mux, channels, board.

    Attributes:
        rate_hz: Clock of the bus [Hz].
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
    """The electronics of one leg and the foot that it measures.

    Args:
        leg: Name of the leg.
        number: Index of the leg, which seeds its noise.
        scene: The scene.
        load: The load of the scene.
        foot: The foot on this leg.
        table: Capacitances of the foot over a gait cycle; None to compute each load.
        board: Electronics: `fdc1004` or `ad7746`.

    Attributes:
        wired: The foot behind the electronics.
        chips: The chips as their bus sees them, the converter first.
    """

    def __init__(
        self,
        leg: str,
        number: int,
        scene: Scene,
        load: ContactSource,
        foot: Foot,
        table: GaitTable | None = None,
        board: str = "fdc1004",
    ) -> None:
        effects = scene.effects
        self._leg = leg
        self._load = load
        self._table = table
        self._foot = foot
        self._rubber = ViscoelasticElement() if effects.rubber else None
        self._last: GroundContact | None = None
        self._last_pf: list[float] = []
        # Faults draw from a stream of their own, so that converters make the same noise with and without them.
        noise, faults, drift = ((scene.seed, number, *stream) for stream in ((), (1,), (2,)))
        own = [fault for fault in scene.faults if getattr(fault, "leg", None) == leg]
        damage = Damage([fault for fault in own if isinstance(fault, OnFoot)], foot)
        self.wired = WiredFoot(self._elements_pf, damage)
        self.chips = failing_chips(
            *electronics(board, self.wired, effects, noise),
            [fault for fault in own if isinstance(fault, OnChips)],
            np.random.default_rng(faults),
        )
        self._softening = effects.softening if effects.softening and effects.softening.leg == leg else None
        self._warming = (
            WarmingFoot(effects.warming, np.random.default_rng(drift)) if effects.warming else None
        )

    def _elements_pf(self, t_ns: int) -> list[float]:
        """Return the capacitance of each element at a time [pF], nine, stray not included."""
        softness = 1.0 if self._warming is None else self._warming.softness(t_ns)
        if self._softening is not None:
            softness *= self._softening.softness(t_ns)
        if self._table is not None and isinstance(self._load, Walk):
            element_pf = self._table.capacitance_pf(self._load.stance_phase(self._leg, t_ns), softness)
        else:
            contact = self._load.contact(self._leg, t_ns)
            if self._rubber is not None:
                contact = GroundContact(*self._rubber.effective_load(t_ns, *contact))
            if softness != 1.0:  # a stiffer solid yields as under a smaller load
                contact = contact._replace(force_n=contact.force_n * softness)
            element_pf = self._solid_pf(contact)
        if self._warming is not None:
            drift_pf = self._warming.drift_pf(t_ns)
            element_pf = [pf + by_pf for pf, by_pf in zip(element_pf, drift_pf, strict=True)]
        return self.wired.damage.elements_pf(element_pf, t_ns)

    def _solid_pf(self, contact: GroundContact) -> list[float]:
        """Return the capacitances under a load [pF], nine; a load that stays is computed once."""
        if self._last is None or not all(map(np.array_equal, contact, self._last)):
            normal, force_n = self._last = contact
            self._last_pf = self._foot.capacitance_pf(normal[None], force_n[None])[0].tolist()
        return self._last_pf


def _feet(scene: Scene, response: FootResponse, legs: Sequence[str]) -> dict[str, Foot]:
    """Return the foot on each leg: one as designed for all, or a fabricated one each."""
    made, contact = scene.fabrication, scene.effects.gap_contact
    if made is None:
        return dict.fromkeys(legs, Foot(response, contact=contact))
    feet = {}
    for number, leg in enumerate(legs, made.first):
        own = fabricate(response, made.tolerances, made.seed, number)
        own = mounted(own, made.remount_deg, made.seed, number, made.mounting)
        feet[leg] = Foot(response, own, contact=contact)
    return feet


def _gait_tables(scene: Scene, load: ContactSource, feet: dict[str, Foot]) -> dict[str, GaitTable]:
    """Return the gait table of each leg; legs with the same foot and load share one."""
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
        scene: The scene.
        response: Response table of its feet.
        buses: Wiring of each bus.

    Attributes:
        clocks: Clock of each bus.
        clock: Clock of a user of all buses.
        buses: The upstream buses: the adapters, unless the kernel drives the mux.
        adapters: Adapter of each leg by name, for every bus whose mux the kernel drives; empty for the others.
        muxes: Mux of each bus, whose RESET pin a line of the host may drive.
        response_sha256: Hash of the response table.
        feet: Foot on each leg.
        legs: Legs by name.
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
                index, foot, table = self._legs.index(leg), self.feet[leg], tables.get(leg)
                self.legs[leg] = SimulatedLeg(leg, index, scene, self._load, foot, table, wiring.board)
            mux = SimulatedMux(wiring.mux_address)
            # A mux that the kernel drives is switched without a system call: each leg adds the cost of the host.
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

    def true_force_n(self, t_ns: int) -> Vector:
        """Return the true force on every foot at a time [N], shape (legs, 3), foot frame."""
        return np.array([self._load.contact(leg, t_ns).force_n for leg in self._legs])
