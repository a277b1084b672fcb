"""Air in the closed cavities of one simulated foot: pressure by load, temperature, weather and leakage."""

import numpy as np

from footsense.foot.cavity import AMBIENT_KPA, ROOM_TEMPERATURE_K, Gas
from footsense.foot.specimen import Foot
from footsense.frames import Vector


class CavityAir:
    """Gas state of the closed cavities of one foot; call in order of time.

    Args:
        foot: The foot.
        ambient_kpa: Ambient pressure [kPa].

    Raises:
        ValueError: The cavities are vented.
    """

    def __init__(self, foot: Foot, ambient_kpa: float = AMBIENT_KPA) -> None:
        gas = foot.cavity.gas
        if gas is None:
            raise ValueError("a vented foot has no air of its own")
        self._foot = foot
        self._ambient_mpa = 1e-3 * ambient_kpa
        # Air that leaks has long taken the ambient pressure.
        leaking = foot.cavity.kind == "leaking"
        self._unloaded_gap_pressure_mpa = (
            np.array([self._ambient_mpa]) if leaking else gas.unloaded_gap_pressure_mpa
        )
        self._t_ns: int | None = None

    def next_capacitance_pf(
        self,
        t_ns: int,
        normal: Vector,
        force_n: Vector,
        relative_compliance: float = 1.0,
        kelvin: float = 0.0,
    ) -> Vector:
        """Return the capacitance of each element under a load [pF], shape (elements,), with stray; advances the air.

        Args:
            t_ns: Time, not before that of the last call [ns].
            normal: Inward normal of the contact, shape (3,).
            force_n: Load since the last call [N], shape (3,).
            relative_compliance: Closures of the solid over those at the start, under the same load [1].
            kelvin: Temperature of the air over that at the start [K].
        """
        elapsed_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * 1e-9
        self._t_ns = t_ns
        warmth = 1.0 + kelvin / ROOM_TEMPERATURE_K
        leak_step_rel = elapsed_s / self._foot.cavity.leak_time_s
        # A softer solid closes as far as the given one under a smaller load and smaller pressures.
        gas = Gas(
            warmth * self._unloaded_gap_pressure_mpa, self._ambient_mpa, step_over_leak_time=leak_step_rel
        ).scaled_for_relative_compliance(relative_compliance)
        element_pf, after = self._foot.capacitance_and_gas_after_step(
            normal[None], relative_compliance * force_n[None], gas
        )
        self._unloaded_gap_pressure_mpa = after.unloaded_gap_pressure_mpa[0] / (warmth * relative_compliance)
        capacitance_pf: Vector = element_pf[0]
        return capacitance_pf
