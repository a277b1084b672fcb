"""Gas state of a foot's cavities: vented, sealed or leaking; amount of air, ambient pressure."""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from footsense.frames import Vector

CavityKind = Literal["vented", "sealed", "leaking"]

#: Pressure of the standard atmosphere [kPa], and in MPa.
AMBIENT_KPA = 101.325
AMBIENT_MPA = 1e-3 * AMBIENT_KPA
#: Room temperature [K], at which a foot's `gas_kpa` is stated.
ROOM_TEMPERATURE_K = 296.15
#: How long a load at rest has lasted when it is read [s]: half of a dwell on the test stand, and its rise.
ASSUMED_LOAD_DURATION_S = 0.3
#: Exponent n of the gas law: walls and air at one temperature, and no heat exchanged (air).
ISOTHERMAL, ADIABATIC = 1.0, 1.4


@dataclass(frozen=True, slots=True, kw_only=True)
class Cavity:
    """Type of a foot's cavities (vented, sealed or leaking), leak time constant, pressure of the enclosed gas.

    Attributes:
        kind: `vented`: the air does not resist; `sealed`: its amount stays; `leaking`: it comes and goes.
        leak_time_s: Time constant of an excess pressure at constant volume, for `leaking` [s].
        gas_kpa: Pressure of sealed air in the unloaded gap at room temperature [kPa].
    """

    kind: CavityKind = "vented"
    leak_time_s: float = math.inf
    gas_kpa: float = AMBIENT_KPA

    def __post_init__(self) -> None:
        """Check that the values are consistent.

        Raises:
            ValueError: A value is impossible, or contradicts the kind.
        """
        if self.kind not in ("vented", "sealed", "leaking"):
            raise ValueError(f"cavity: vented, sealed or leaking, got {self.kind!r}")
        if not self.leak_time_s > 0.0 or (self.kind == "leaking") != math.isfinite(self.leak_time_s):
            raise ValueError(
                f"leak_time_s: a leaking cavity has one above 0 s, others have none, got {self.leak_time_s:g}"
            )
        if not (0.0 < self.gas_kpa < math.inf) or (self.kind != "sealed" and self.gas_kpa != AMBIENT_KPA):
            raise ValueError(f"gas_kpa: above 0, and of a sealed cavity alone, got {self.gas_kpa:g}")

    @property
    def gas(self) -> "Gas | None":
        """Gas state of an unloaded foot at room temperature and standard pressure; None for vented cavities."""
        if self.kind == "vented":
            return None
        return Gas(np.array([1e-3 * self.gas_kpa]), AMBIENT_MPA)


#: Cavities open to the ambient air, as of the released foot.
VENTED = Cavity()


class Gas(NamedTuple):
    """State of the air in the cavities, and the ambient pressure.

    Attributes:
        unloaded_gap_pressure_mpa: Pressure that the enclosed air would have in the unloaded gap: the measure m of its
            amount [MPa]. Shape (elements,), (1,) if all cavities are alike, or one row for each load, (n, 9).
        ambient_mpa: Ambient pressure [MPa].
        exponent: Exponent n of the gas law.
        step_over_leak_time: A step s of time over the time constant of the leak [1]; 0 where nothing leaks.
    """

    unloaded_gap_pressure_mpa: Vector
    ambient_mpa: float = AMBIENT_MPA
    exponent: float = ISOTHERMAL
    step_over_leak_time: float = 0.0

    def scaled_for_relative_compliance(self, relative_compliance: float) -> "Gas":
        """Return the gas state for a rubber softer by a factor, to be used with the unchanged compliance.

        Closures stay equal if loads and pressures are multiplied in place of the compliance.
        """
        return self._replace(
            unloaded_gap_pressure_mpa=relative_compliance * self.unloaded_gap_pressure_mpa,
            ambient_mpa=relative_compliance * self.ambient_mpa,
        )

    def after_leak_step(self, excess_mpa: Vector) -> "Gas":
        """Return the gas state after a time step whose leakage is driven by an excess pressure [MPa]."""
        return self._replace(
            unloaded_gap_pressure_mpa=self.unloaded_gap_pressure_mpa - self.step_over_leak_time * excess_mpa,
            step_over_leak_time=0.0,
        )
