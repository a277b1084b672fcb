"""The simulated robot of a scene: feet, chips, buses and clocks.

The load of the scene presses each foot; the response table turns contacts into gap closures, those into capacitances;
the row switch connects some of them to the pins of the converter.
"""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from firmware_interface.chips import ad7147
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import Vector
from footsense.sim.chips.chip import SimulatedMux
from footsense.sim.clock import JoinedClock, VirtualClock
from footsense.sim.couplings import BoardCouplings
from footsense.sim.fabrication import draw_deviations, with_new_mounting, with_session_gains
from footsense.sim.faults.scene_faults import MuxKeepsChannels, StuckSda, WireFault
from footsense.sim.faults.wire_faults import WireFaults
from footsense.sim.i2c_bus import SimulatedBus
from footsense.sim.leg import SimulatedLeg
from footsense.sim.loads.gait_table import GaitTable
from footsense.sim.loads.ground_load import ContactSource
from footsense.sim.loads.load_log import RepeatedLog
from footsense.sim.loads.walk import Walk
from footsense.sim.rubber import relative_compliance_when_warmed
from footsense.sim.scene import Scene


class BusWiring(NamedTuple):
    """Wiring of one simulated bus: bus rate, mux address, mux channel of each leg, board.

    Attributes:
        bus_clock_hz: Clock of the bus [Hz].
        mux_address: Address of its mux; None for legs directly on the bus.
        channels: Mux channel of each leg; 0 without one.
        addresses: Address of the converter of each leg, of board `ad7147`.
        board: Electronics of its legs: `fdc1004` or `ad7147`.
    """

    bus_clock_hz: int
    mux_address: int | None
    channels: dict[str, int]
    addresses: Mapping[str, int] = MappingProxyType({})
    board: str = "fdc1004"

    @property
    def legs_by_channel(self) -> dict[int, list[str]]:
        """Legs on each channel."""
        return {
            channel: [leg for leg in self.channels if self.channels[leg] == channel]
            for channel in dict.fromkeys(self.channels.values())
        }


def _feet(scene: Scene, response: FootResponse, legs: Sequence[str]) -> dict[str, Specimen]:
    """Return the foot of each leg: the same designed foot for all, or one fabricated foot per leg."""
    made, contact = scene.fabrication, scene.effects.gap_contact
    if made is None:
        return dict.fromkeys(legs, Specimen(response, contact=contact))
    feet = {}
    for number, leg in enumerate(legs, made.first):
        own = draw_deviations(response, made.tolerances, made.seed, number)
        own = with_new_mounting(own, made.remount_deg, made.seed, number, made.mounting)
        own = with_session_gains(own, made.gain_rel, made.seed, number, made.session)
        feet[leg] = Specimen(response, own, contact=contact)
    return feet


def _gait_tables(scene: Scene, load: ContactSource, feet: dict[str, Specimen]) -> dict[str, GaitTable]:
    """Return the precomputed capacitance table of each leg; legs with the same foot and load share one."""
    if not isinstance(load, Walk):
        return {}
    warming = scene.effects.warming
    warmed = 1.0 if warming is None else relative_compliance_when_warmed(warming.kelvin)
    one_of = {(foot, load.reaction[leg]): leg for leg, foot in feet.items()}
    tables = {which: GaitTable(which[0], load, leg, (1.0, warmed)) for which, leg in one_of.items()}
    return {leg: tables[foot, load.reaction[leg]] for leg, foot in feet.items()}


class SimulatedRobot:
    """Simulated robot of a scene: feet under their loads, chips, I2C buses and clocks.

    Args:
        scene: The scene.
        response: Response table of its feet.
        buses: Wiring of each bus.
        grace_ns: Time that a user of all buses waits for the later ones [ns].
        couplings: Couplings of the feet's lines by board; a board without has none.

    Raises:
        ConfigError: The scene's log is none, or lacks a leg.

    Attributes:
        clock: Clock of a user of all buses.
        buses: The buses.
        response_sha256: Hash of the response table.
        feet: Foot on each leg.
        legs: Legs by name.
    """

    def __init__(
        self,
        scene: Scene,
        response: FootResponse,
        buses: Sequence[BusWiring],
        grace_ns: float = math.inf,
        couplings: Mapping[str, BoardCouplings] = MappingProxyType({}),
    ) -> None:
        self._load = scene.load.build(round(scene.lead_in_s * 1e9))
        self.response_sha256 = response.sha256
        self._legs = tuple(leg for wiring in buses for leg in wiring.channels)
        if isinstance(self._load, RepeatedLog):
            self._load.require_legs(self._legs)
        self.feet = _feet(scene, response, self._legs)
        tables = _gait_tables(scene, self._load, self.feet) if scene.gait_table else {}
        self.legs: dict[str, SimulatedLeg] = {}
        self.buses: list[SimulatedBus] = []
        for number, wiring in enumerate(buses):
            for leg in wiring.channels:
                index, foot, table = self._legs.index(leg), self.feet[leg], tables.get(leg)
                address = wiring.addresses.get(leg, ad7147.ADDRESSES[0])
                chips = wiring.board, couplings.get(wiring.board), address, wiring.bus_clock_hz
                self.legs[leg] = SimulatedLeg(leg, index, scene, self._load, foot, table, *chips)
            broken = [
                fault
                for fault in scene.faults
                if isinstance(fault, WireFault)
                and (fault.leg in wiring.channels if isinstance(fault, StuckSda) else fault.bus == number)
            ]
            mux = None if wiring.mux_address is None else SimulatedMux(wiring.mux_address)
            if mux is not None:
                mux.keeps_channels_ns = [f.span_ns for f in broken if isinstance(f, MuxKeepsChannels)]
            timeout_ns = round(scene.effects.adapter_timeout_ms * 1e6)
            rng = np.random.default_rng((scene.seed, number, 3))
            bus = SimulatedBus(
                VirtualClock(),
                rate_hz=wiring.bus_clock_hz,
                host_cost_ns=round(scene.host_cost_us * 1e3),
                mux=mux,
                legs={
                    channel: [chip for leg in legs for chip in self.legs[leg].chips]
                    for channel, legs in wiring.legs_by_channel.items()
                },
                faults=WireFaults(
                    broken, wiring.channels, timeout_ns, rng, adapter_compares=scene.effects.adapter_compares
                )
                if broken
                else None,
            )
            self.buses.append(bus)
        self.clock = JoinedClock([bus.clock for bus in self.buses], grace_ns)

    def true_force_n_at(self, t_ns: int) -> Vector:
        """Return the true force on every foot at a time [N], shape (legs, 3), foot frame."""
        return np.array([self._load.contact(leg, t_ns).force_n for leg in self._legs])
