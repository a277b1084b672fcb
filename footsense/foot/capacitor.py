"""Electrical model of a foot's capacitors: conversion between gap closure [um] and capacitance [pF].

One element is two square electrodes with an air gap and a polymer film between them, the gap closing under load:

    C = eps0 A / (g - d + t_film / eps_r) + C_stray

The elastance 1 / (C - C_stray) is linear in the closure d where C is not, so the daemon inverts this law exactly
instead of linearising it. Fringing fields are not modelled here.
"""

from dataclasses import dataclass

import numpy as np

from footsense.frames import Vector

#: Electric constant in the units of this module [pF um / mm2]: 8.8541878128e-12 F/m, CODATA 2018.
EPS0_PF_UM_PER_MM2 = 8.8541878128


#: Closure over the gap above which an element counts as closed [1].
GAP_CLOSED_THRESHOLD_REL = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Capacitor:
    """Designed dimensions and film permittivity of every element of a foot type.

    Attributes:
        gap_um: Air gap g at rest [um].
        film_um: Film in series with the gap [um].
        film_eps_r: Relative permittivity of the film [1].
        electrode_area_mm2: Area of one electrode [mm2].
    """

    gap_um: float
    film_um: float
    film_eps_r: float
    electrode_area_mm2: float

    @property
    def film_equivalent_um(self) -> float:
        """Thickness of an air layer with the same elastance (1/C) as the film [um]."""
        return self.film_um / self.film_eps_r

    @property
    def unloaded_pf(self) -> float:
        """Capacitance of an unloaded element as designed, without stray [pF].

        Example:
            >>> sheet = Capacitor(gap_um=20.0, film_um=17.0, film_eps_r=2.7, electrode_area_mm2=16.0)
            >>> round(sheet.unloaded_pf, 3)
            5.387
        """
        return float(self.capacitance_pf(np.zeros(1))[0])

    def capacitance_pf(self, closure_um: Vector) -> Vector:
        """Return the capacitance without stray [pF] at a mean gap closure [um] below gap_um, same shape."""
        plate_distance_um = self.gap_um - closure_um + self.film_equivalent_um
        return EPS0_PF_UM_PER_MM2 * self.electrode_area_mm2 / plate_distance_um

    def plate_distance_um(self, capacitance_pf: Vector) -> Vector:
        """Return the equivalent plate distance in air [um] of a capacitance [pF], the film included.

        Args:
            capacitance_pf: Capacitance without stray [pF], any shape.
        """
        return EPS0_PF_UM_PER_MM2 * self.electrode_area_mm2 / capacitance_pf

    def closure_um(self, capacitance_pf: Vector, baseline_pf: Vector) -> Vector:
        """Return the gap closure [um] between the baseline and a capacitance [pF], positive when pressed.

        The gap itself drops out, so a foot whose gaps are not the designed ones is measured right.

        Args:
            capacitance_pf: Capacitance without stray [pF], any shape, each above 0.
            baseline_pf: The same element unloaded, without stray [pF], of a shape that broadcasts.

        Returns:
            Closure [um]; NaN where an input is.

        Example:
            >>> sheet = Capacitor(gap_um=20.0, film_um=17.0, film_eps_r=2.7, electrode_area_mm2=16.0)
            >>> pressed = sheet.capacitance_pf(np.array([5.0]))
            >>> round(float(sheet.closure_um(pressed, np.array([sheet.unloaded_pf]))[0]), 9)
            5.0
        """
        return self.plate_distance_um(baseline_pf) - self.plate_distance_um(capacitance_pf)
