"""The simulated robot: feet, chips, buses and time, put together for a scene.

A foot is pressed by the scene's load; the response table turns contact into gap closures, those into capacitances;
the row switch decides which of them a converter pin sees.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.sim.bus import SimulatedBus, SimulatedMux
from footsense.sim.clock import JoinedClock, VirtualClock
from footsense.sim.fabricated import Foot
from footsense.sim.fdc1004_chip import SimulatedFdc1004
from footsense.sim.foot import FootResponse
from footsense.sim.load import Load
from footsense.sim.row_switch import FLOATING_ROW_PF, SimulatedRowSwitch
from footsense.sim.scene import Absent, BrokenRow, BrownOut, DeafSwitch, Fault, Scene, StuckConverter

_COLUMNS = 3
_ROWS = 3


class Wiring(NamedTuple):
    """One simulated bus: its clock rate, the mux address, and each leg's mux channel."""

    rate_hz: int
    mux_address: int
    channels: dict[str, int]


class SimulatedLeg:
    """The electronics of one leg and the foot that it reads.

    Args:
        leg: Name of the leg.
        number: Its place among the legs, which seeds its noise.
        scene: What the robot does.
        load: The scene's load.
        response: How its foot yields.
    """

    def __init__(self, leg: str, number: int, scene: Scene, load: Load, response: FootResponse) -> None:
        self._leg = leg
        self._load = load
        self._foot = Foot(response, contact=scene.effects.gap_contact)
        self._stray_pf = scene.effects.stray_pf
        self._broken_rows: list[tuple[int, int]] = []
        random = np.random.default_rng((scene.seed, number))
        self.switch = SimulatedRowSwitch()
        self.converter = SimulatedFdc1004(
            self._cin_capacitance_pf,
            noise=random if scene.effects.converter_noise else None,
            clock_error_rel=scene.effects.converter_clock_rel * random.uniform(-1, 1),
        )
        for fault in scene.faults:
            if fault.leg == leg:
                self._apply(fault)

    def _apply(self, fault: Fault) -> None:
        match fault:
            case Absent():
                self.switch.absent_ns = self.converter.absent_ns = (fault.at_ns, fault.until_ns)
            case BrownOut():
                self.switch.brown_out_ns = self.converter.brown_out_ns = fault.at_ns
            case DeafSwitch():
                self.switch.deaf_from_ns = fault.at_ns
            case StuckConverter():
                self.converter.stuck_ns = (fault.at_ns, math.inf)
            case BrokenRow():
                self._broken_rows.append((fault.at_ns, fault.row))

    def _cin_capacitance_pf(self, cin: int, t_start_ns: int, t_end_ns: int) -> float:
        """Return the mean capacitance of a pin to ground: its column, through the rows that are grounded.

        The load is taken at the middle of the conversion, the row switches as they were during it. A shielded row
        drops out; a row that nothing drives is seen in series with its own small capacitance to ground.
        """
        t_middle_ns = (t_start_ns + t_end_ns) // 2
        contact = self._load.contact(self._leg, t_middle_ns)
        element_pf = self._foot.capacitance_pf(contact.normal[None], contact.force_n[None])[0]
        column_pf = element_pf[cin::_COLUMNS] + self._stray_pf
        broken = sum(1 << row for at_ns, row in self._broken_rows if at_ns <= t_middle_ns)
        total_pf = 0.0
        for share, states in self.switch.between(t_start_ns, t_end_ns):
            for row in range(_ROWS):
                bit = 1 << row
                pf = float(column_pf[row])
                if broken & bit or not (states.grounded | states.shielded) & bit:
                    total_pf += share * pf * FLOATING_ROW_PF / (pf + FLOATING_ROW_PF)
                elif states.grounded & bit:
                    total_pf += share * pf
        return total_pf


class SimulatedRobot:
    """A robot in a scene.

    Args:
        scene: What it does.
        response: How its feet yield.
        buses: Its wiring.

    Attributes:
        clocks: The time of each bus.
        clock: The time of whoever uses all buses together.
        buses: The adapters.
        response_sha256: Hash of the table that its feet follow.
    """

    def __init__(self, scene: Scene, response: FootResponse, buses: Sequence[Wiring]) -> None:
        self._load = scene.load.build(round(scene.lead_in_s * 1e9))
        self.response_sha256 = response.sha256
        self._legs = tuple(leg for wiring in buses for leg in wiring.channels)
        self.clocks = tuple(VirtualClock() for _ in buses)
        self.clock = JoinedClock(self.clocks)
        self.buses = []
        for wiring, clock in zip(buses, self.clocks, strict=True):
            legs = {
                channel: SimulatedLeg(leg, self._legs.index(leg), scene, self._load, response)
                for leg, channel in wiring.channels.items()
            }
            self.buses.append(
                SimulatedBus(
                    clock,
                    rate_hz=wiring.rate_hz,
                    host_cost_ns=round(scene.host_cost_us * 1e3),
                    mux=SimulatedMux(wiring.mux_address),
                    legs={channel: (leg.converter, leg.switch) for channel, leg in legs.items()},
                )
            )

    def felt_n(self, t_ns: int) -> NDArray[np.float64]:
        """Return the force that every foot really feels at a time [N], shape (legs, 3), foot frame."""
        return np.stack([self._load.contact(leg, t_ns).force_n for leg in self._legs])
