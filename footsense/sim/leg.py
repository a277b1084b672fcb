"""One simulated leg: a foot under its load, and the chips that measure it."""

import numpy as np

from firmware_interface.chips import ad7147
from footsense.foot.specimen import Specimen
from footsense.frames import ELEMENTS
from footsense.sim.chips.electronics import leg_electronics
from footsense.sim.couplings import BoardCouplings
from footsense.sim.faults.chip_faults import inject_chip_faults
from footsense.sim.faults.damage import WiredFoot
from footsense.sim.faults.disturbances import Disturbances
from footsense.sim.faults.scene_faults import ChipFault, Disturbance, FootDamage
from footsense.sim.loads.gait_table import GaitTable
from footsense.sim.loads.ground_load import ContactSource, GroundContact
from footsense.sim.loads.load_log import RepeatedLog
from footsense.sim.loads.log_table import LogTable
from footsense.sim.loads.walk import Walk
from footsense.sim.rubber import RUBBER_LEVELS, ElementCreep, ViscoelasticRubber, WarmingFoot, draw_floor_pf
from footsense.sim.scene import Scene


class SimulatedLeg:
    """One simulated leg: a foot under its load over time, and the chips that measure it.

    Args:
        leg: Name of the leg.
        number: Index of the leg, which seeds its noise.
        scene: The scene.
        load: The load of the scene.
        foot: The foot on this leg.
        table: Capacitances of the foot over a gait cycle; None to compute each load.
        board: Electronics: `fdc1004` or `ad7147`.
        couplings: Couplings of the foot's lines with it; None for none.
        address: Address of its converter, of board `ad7147`.
        bus_clock_hz: Clock of its bus [Hz].

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
        foot: Specimen,
        table: GaitTable | None = None,
        board: str = "fdc1004",
        couplings: BoardCouplings | None = None,
        address: int = ad7147.ADDRESSES[0],
        bus_clock_hz: int = 400_000,
    ) -> None:
        effects = scene.effects
        self._leg = leg
        self._load = load
        self._table = table
        self._foot = foot
        self._rubber = ViscoelasticRubber(*RUBBER_LEVELS[effects.rubber_level]) if effects.rubber else None
        self._last: GroundContact | None = None
        self._last_pf: list[float] = []
        # Faults draw from a stream of their own, so that converters make the same noise with and without them.
        noise, faults, drift, added, creep, floor = (
            (scene.seed, number, *stream) for stream in ((), (1,), (2,), (3,), (4,), (5,))
        )
        own = [fault for fault in scene.faults if getattr(fault, "leg", None) == leg]
        on_foot = [fault for fault in own if isinstance(fault, FootDamage)]
        disturbing = [each for each in scene.faults if isinstance(each, Disturbance) and leg in each.legs]
        disturbances = None
        if disturbing:
            metal_ff = (0.0,) * ELEMENTS if couplings is None else couplings.element_metal_ff
            disturbances = Disturbances(disturbing, np.random.default_rng(added), metal_ff)
        self.wired = WiredFoot(self._undamaged_capacitance_pf, on_foot, foot, disturbances)
        self.chips = inject_chip_faults(
            *leg_electronics(board, self.wired, effects, noise, couplings, address, bus_clock_hz),
            [fault for fault in own if isinstance(fault, ChipFault)],
            np.random.default_rng(faults),
        )
        self._element_creep = None
        if effects.creep_spread_rel:
            random = np.random.default_rng(creep)
            self._element_creep = ElementCreep(effects.creep_spread_rel, foot.unloaded_pf, random)
        self._floor_pf = None
        if effects.floor_pf:
            self._floor_pf = draw_floor_pf(effects.floor_pf, np.random.default_rng(floor)).tolist()
        self._warming = None
        if effects.warming:
            self._warming = WarmingFoot(effects.warming, np.random.default_rng(drift))
        self._log_table = None
        if scene.gait_table and isinstance(load, RepeatedLog):
            self._log_table = LogTable(foot, load, leg, self._rubber, self._element_creep)

    def _undamaged_capacitance_pf(self, t_ns: int) -> list[float]:
        """Return each element's capacitance at a time [ns], without damage and without the scene's `stray_pf` [pF]."""
        relative_compliance = 1.0 if self._warming is None else self._warming.relative_compliance(t_ns)
        if self._table is not None and isinstance(self._load, Walk):
            element_pf = self._table.capacitance_pf(
                self._load.gait_phase_in_stance(self._leg, t_ns), relative_compliance
            )
        elif self._log_table is not None:
            element_pf = self._log_table.capacitance_pf(t_ns)
        else:
            contact = self._load.contact(self._leg, t_ns)
            if self._rubber is not None:
                contact = GroundContact(*self._rubber.next_effective_load(t_ns, *contact))
            if relative_compliance != 1.0:  # a stiffer solid yields as under a smaller load
                contact = contact._replace(force_n=contact.force_n * relative_compliance)
            element_pf = self._loaded_capacitance_pf(contact)
            if self._element_creep is not None:
                element_pf = self._element_creep.next_capacitance_pf(t_ns, np.array(element_pf)).tolist()
        if self._floor_pf is not None and self._load.contact(self._leg, t_ns).force_n.any():
            element_pf = [pf + floor_pf for pf, floor_pf in zip(element_pf, self._floor_pf, strict=True)]
        if self._warming is not None:
            drift_pf = self._warming.drift_pf(t_ns)
            element_pf = [pf + by_pf for pf, by_pf in zip(element_pf, drift_pf, strict=True)]
        return element_pf

    def _loaded_capacitance_pf(self, contact: GroundContact) -> list[float]:
        """Return each element's capacitance under a load [pF]; recomputed only when the load changes."""
        if self._last is None or not all(map(np.array_equal, contact, self._last)):
            normal, force_n = self._last = contact
            self._last_pf = self._foot.capacitance_pf(normal[None], force_n[None])[0].tolist()
        return self._last_pf
