"""Baselines of all legs, and the plate distances of the unloaded feet that follow from them."""

from typing import NamedTuple

import numpy as np

from footsense.foot.capacitor import CapacitorDesign
from footsense.frames import Mask, Vector


class UnloadedFeet(NamedTuple):
    """Baselines of all legs with arrays derived from them; replaced when a baseline changes.

    Attributes:
        baseline_pf: Unloaded capacitances without stray [pF], shape (legs, elements), NaN where there is none.
        plate_distance_rel: Plate distances over the gap [1], shape (legs, elements).
        untared_legs: Legs without any baseline, shape (legs,).
        untared_elements_of_tared_legs: Elements without a baseline on legs that have others, shape (legs, elements).
        complete: Whether every element of every leg has a baseline.
    """

    baseline_pf: Vector
    plate_distance_rel: Vector
    untared_legs: Mask
    untared_elements_of_tared_legs: Mask
    complete: bool


def unloaded_feet(baseline_pf: Vector, design: CapacitorDesign, gain_rel: Vector) -> UnloadedFeet:
    """Return baselines with the arrays derived from them.

    Args:
        baseline_pf: Unloaded capacitances without stray [pF], shape (legs, elements), NaN where there is none.
        design: The capacitors.
        gain_rel: Closure of each element by the design's electrodes, over its real closure [1], shape (legs, elements).
    """
    without_baseline: Mask = np.isnan(baseline_pf)
    untared_legs: Mask = np.asarray(without_baseline.all(axis=1))
    return UnloadedFeet(
        baseline_pf=baseline_pf,
        plate_distance_rel=design.plate_distance_um(baseline_pf) / design.gap_um / gain_rel,
        untared_legs=untared_legs,
        untared_elements_of_tared_legs=without_baseline & ~untared_legs[:, None],
        complete=not without_baseline.any(),
    )
