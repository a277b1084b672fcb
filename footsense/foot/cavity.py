"""Air in a foot's cavities: vented, sealed or leaking, and its pressure when the gaps close.

A closure d of the gap leaves the share v = 1 - d/g of a cavity's volume, d and g being means over its area. The air in
it then has the pressure p of the gas law, and presses on both plates by what it is above the ambient pressure p_a:

    p v^n = m,        q = p - p_a,        d = d0 - B (l + A q)

with d0 the closures of an empty foot, B the compliance, l the forces of closed gaps (`gap_contact.py`) and A the area
of a cell. m is the pressure that the air would have in the unloaded gap: the measure of its amount. n is 1 where the
air keeps the temperature of the walls, which a gap of 20 um does within microseconds, and 1.4 where it keeps its heat.

Air that leaks does so in proportion to q: dm/dt = -q / tau, with tau the time in which an excess pressure falls to 1/e
in a cavity of constant volume. One step of the implicit Euler method needs the same solution (n = 1), with v = m / p
- s q / p and s = dt / tau: it is stable for any step, and a long one ends at a vented foot.

The pressures are found by Newton's method. The problem is the gradient of a convex function, so it has one solution.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from footsense.foot.gap_contact import CELLS_PER_ELEMENT, element_means, solve_contact_lcp
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
#: Newton steps at most; six are usual, eight with gaps in contact.
_MAX_NEWTON_STEPS = 60
#: Steps of time in which air leaks from a foot under a load that stays.
_N_LEAK_STEPS = 6
#: Largest rest of a mean closure over the gap [1].
_TOLERANCE_REL = 1e-10
#: Least share of the absolute pressure that a step leaves [1], so that no pressure becomes negative.
_MIN_REMAINING_PRESSURE_REL = 0.2


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


class CavityPressures:
    """Solver for gap closures and air pressures in the cavities of one foot.

    Args:
        gap_um: Gap of each element [um], shape (elements,).
        compliance_um_per_n: B of the specimen, shape (324, 324).
        element_mm2: Area of an element [mm2].
    """

    def __init__(self, gap_um: Vector, compliance_um_per_n: Vector, element_mm2: float) -> None:
        self._gap_um = gap_um
        self._gap_of_cell_um = np.repeat(gap_um, CELLS_PER_ELEMENT)
        self._compliance = compliance_um_per_n
        #: Opening of each cell under a unit pressure in each cavity [um/MPa], shape (324, 9).
        self._opening: Vector = (
            compliance_um_per_n.reshape(-1, len(gap_um), CELLS_PER_ELEMENT).sum(axis=2)
            * element_mm2
            / CELLS_PER_ELEMENT
        )
        self._mean_opening = element_means(self._opening.T).T

    def closures_and_excess_pressures(
        self, free_um: Vector, gas: Gas, *, contact: bool
    ) -> tuple[Vector, Vector]:
        """Return cell closures [um], shape (n, 324), and excess air pressures [MPa], shape (n, elements).

        Args:
            free_um: Closures of an empty foot without contact [um], shape (n, 324).
            gas: The air.
            contact: Whether a closed gap carries load; else closures are only limited to the gap.

        Raises:
            ArithmeticError: Newton's method does not converge.
        """
        excess_mpa = self._pressures_without_contact_mpa(element_means(free_um), gas)
        closure_um = free_um - excess_mpa @ self._opening.T
        if not contact:
            return np.minimum(closure_um, self._gap_of_cell_um), excess_mpa
        unloaded_gap_pressure_mpa = np.broadcast_to(gas.unloaded_gap_pressure_mpa, excess_mpa.shape)
        for load in np.flatnonzero((closure_um > self._gap_of_cell_um).any(axis=1)):
            own = gas._replace(unloaded_gap_pressure_mpa=unloaded_gap_pressure_mpa[load])
            closure_um[load], excess_mpa[load] = self._solve_in_contact(free_um[load], excess_mpa[load], own)
        return closure_um, excess_mpa

    def sustained_closures_um(self, free_um: Vector, cavity: Cavity, *, contact: bool) -> Vector:
        """Return the cell closures [um], shape (n, 324), under loads applied for `ASSUMED_LOAD_DURATION_S`.

        Args:
            free_um: Closures of an empty foot without contact [um], shape (n, 324).
            cavity: How the cavities hold their air, not vented.
            contact: Whether a closed gap carries load.
        """
        gas = Gas(np.full(len(self._gap_um), 1e-3 * cavity.gas_kpa))
        if cavity.kind == "leaking":
            for _ in range(_N_LEAK_STEPS):
                gas = gas._replace(
                    step_over_leak_time=ASSUMED_LOAD_DURATION_S / _N_LEAK_STEPS / cavity.leak_time_s
                )
                gas = gas.after_leak_step(
                    self.closures_and_excess_pressures(free_um, gas, contact=contact)[1]
                )
        return self.closures_and_excess_pressures(free_um, gas, contact=contact)[0]

    def _volume_and_negative_slope(self, excess_mpa: Vector, gas: Gas) -> tuple[Vector, Vector]:
        """Return each cavity's relative volume [1] at an excess pressure [MPa], and its negative derivative [1/MPa]."""
        pressure_mpa = excess_mpa + gas.ambient_mpa
        volume_without_leak: Vector = (gas.unloaded_gap_pressure_mpa / pressure_mpa) ** (1.0 / gas.exponent)
        volume: Vector = volume_without_leak - gas.step_over_leak_time * excess_mpa / pressure_mpa
        return volume, (
            volume_without_leak / gas.exponent + gas.step_over_leak_time * gas.ambient_mpa / pressure_mpa
        ) / pressure_mpa

    def _pressures_without_contact_mpa(self, free_um: Vector, gas: Gas) -> Vector:
        """Return the excess air pressures [MPa], shape (n, elements), for gaps that do not touch.

        Raises:
            ArithmeticError: Newton's method does not converge.
        """
        excess_mpa = np.zeros_like(free_um)
        for _ in range(_MAX_NEWTON_STEPS):
            volume, slope = self._volume_and_negative_slope(excess_mpa, gas)
            rest_um = free_um - excess_mpa @ self._mean_opening.T - self._gap_um * (1.0 - volume)
            if (np.abs(rest_um) <= _TOLERANCE_REL * self._gap_um).all():
                return excess_mpa
            matrix = self._mean_opening + (self._gap_um * slope)[:, :, None] * np.eye(len(self._gap_um))
            step_mpa = np.asarray(np.linalg.solve(matrix, rest_um[:, :, None])[:, :, 0], np.float64)
            excess_mpa = self._pressures_after_newton_step_mpa(excess_mpa, step_mpa, gas)
        raise ArithmeticError(
            "the pressures of the cavities do not converge: is the compliance positive definite?"
        )

    def _solve_in_contact(self, free_um: Vector, excess_mpa: Vector, gas: Gas) -> tuple[Vector, Vector]:
        """Return cell closures [um], shape (cells,), and excess pressures [MPa], shape (elements,), of one load.

        Raises:
            ArithmeticError: Newton's method does not converge.
        """
        largest_um, share = math.inf, 1.0
        step_mpa = np.zeros(len(self._gap_um))
        for _ in range(_MAX_NEWTON_STEPS):
            pressed_um = free_um - self._opening @ excess_mpa
            closure_um = solve_contact_lcp(
                pressed_um, self._gap_of_cell_um, self._compliance
            ).cell_closures_um
            volume, slope = self._volume_and_negative_slope(excess_mpa, gas)
            rest_um = element_means(closure_um) - self._gap_um * (1.0 - volume)
            size_um = float(np.abs(rest_um).max())
            if size_um <= _TOLERANCE_REL * self._gap_um.min():
                return closure_um, excess_mpa
            if (
                size_um > largest_um and share > 1e-3
            ):  # the set of closed cells changed too much: half of the step
                share *= 0.5
                excess_mpa = excess_mpa - share * step_mpa
                continue
            largest_um, share = size_um, 1.0
            closed = np.flatnonzero(closure_um >= self._gap_of_cell_um)
            carried = np.linalg.solve(self._compliance[np.ix_(closed, closed)], self._opening[closed])
            opening = element_means((self._opening - self._compliance[:, closed] @ carried).T).T
            stiffness = opening + np.diag(self._gap_um * slope)
            newton_mpa = np.asarray(np.linalg.solve(stiffness, rest_um), np.float64)
            moved = self._pressures_after_newton_step_mpa(excess_mpa, newton_mpa, gas)
            step_mpa, excess_mpa = moved - excess_mpa, moved
        raise ArithmeticError("the pressures of the cavities do not converge with gaps in contact")

    @staticmethod
    def _pressures_after_newton_step_mpa(excess_mpa: Vector, step_mpa: Vector, gas: Gas) -> Vector:
        """Return the excess pressures after a Newton step [MPa], shortened where it would give a vacuum."""
        least = _MIN_REMAINING_PRESSURE_REL * (excess_mpa + gas.ambient_mpa) - gas.ambient_mpa
        return np.maximum(excess_mpa + step_mpa, least)
