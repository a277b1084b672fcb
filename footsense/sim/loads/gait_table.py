"""Precomputed capacitances of a foot over one gait cycle, to simulate long walks quickly.

The load of a walk depends on the phase alone. The capacitances depend on the phase and on the compliance of the rubber,
which changes with temperature and age; between the points of both they are interpolated linearly.
"""

import math

import numpy as np

from footsense.foot.specimen import Specimen
from footsense.sim.loads.walk import Walk

#: Time between two points of a table [ns]: error of 0.03 fF where no gap closes.
TABLE_STEP_NS = 250_000
#: Step of the relative compliance between two tables [1].
_SOFTNESS_STEP = 0.005


class GaitTable:
    """Table of one foot's capacitances over the stance phase of one leg.

    Args:
        foot: The foot.
        walk: The walk.
        leg: Leg of the foot.
        compliance_bounds_rel: Bounds of the closures over those at the begin [1].

    Attributes:
        unloaded_pf: Capacitance of each element in the air [pF], nine.
    """

    def __init__(
        self, foot: Specimen, walk: Walk, leg: str, compliance_bounds_rel: tuple[float, float] = (1.0, 1.0)
    ) -> None:
        self.unloaded_pf: list[float] = foot.unloaded_pf.tolist()
        self._n_steps = math.ceil(walk.duty_rel * walk.period_ns / TABLE_STEP_NS)
        self._per_phase = self._n_steps / walk.duty_rel
        # The last point belongs to the stance: at its end a foot may still carry.
        phases = np.linspace(0.0, walk.duty_rel, self._n_steps + 1)
        contacts = [walk.contact_at_phase(leg, phase) for phase in phases.tolist()]
        normal = np.array([contact.normal for contact in contacts])
        force_n = np.array([contact.force_n for contact in contacts])
        low, high = min(compliance_bounds_rel), max(compliance_bounds_rel)
        levels = np.linspace(low, high, 1 + math.ceil((high - low) / _SOFTNESS_STEP))
        self._low = low
        self._levels_per_relative_compliance = (len(levels) - 1) / (high - low) if high > low else 0.0
        # Rows of floats: arithmetic with nine numbers is faster without arrays.
        self._tables: list[list[list[float]]] = [
            foot.capacitance_pf(normal, relative_compliance * force_n).tolist()
            for relative_compliance in levels.tolist()
        ]

    def capacitance_pf(self, phase: float | None, relative_compliance: float = 1.0) -> list[float]:
        """Return each element's capacitance at a gait phase in stance [pF], interpolated; phase None is the swing.

        Args:
            phase: Phase of the leg within its stance [1]; None in the air.
            relative_compliance: Closures over those at the begin [1].
        """
        if phase is None:
            return self.unloaded_pf
        level = (relative_compliance - self._low) * self._levels_per_relative_compliance
        below = min(int(level), len(self._tables) - 1)
        lower_pf = self._interpolate_table(self._tables[below], phase)
        part = level - below
        if part <= 0.0:
            return lower_pf
        return _interpolate(lower_pf, self._interpolate_table(self._tables[below + 1], phase), part)

    def _interpolate_table(self, table: list[list[float]], phase: float) -> list[float]:
        """Return a table's capacitances at a phase [pF], interpolated linearly."""
        place = phase * self._per_phase
        step = min(int(place), self._n_steps - 1)
        return _interpolate(table[step], table[step + 1], place - step)


def _interpolate(from_pf: list[float], to_pf: list[float], part: float) -> list[float]:
    """Return the values between two lists of values, at the fraction `part` from the first to the second."""
    return [a_pf + part * (b_pf - a_pf) for a_pf, b_pf in zip(from_pf, to_pf, strict=True)]
