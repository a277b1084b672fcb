"""Distances of the plates of feet that nothing touches."""

import numpy as np
from numpy.typing import NDArray

from footsense.foot.capacitor import CapacitorDesign

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]


class AtRest:
    """What follows from the baselines; they change seldom.

    Args:
        baseline_pf: Unloaded capacitances without stray [pF], shape (legs, 9), NaN where there is none.
        design: The capacitors.
        gain_rel: Closure of each element by the design's electrodes, of its real closure [1], shape (legs, 9).

    Attributes:
        baseline_pf: As given.
        distance_rel: Distances over the gap [1], shape (legs, 9).
        untared_legs: Legs without any, shape (legs,).
        untared: Elements without one on legs that have others, shape (legs, 9).
        whole: Whether there are none of those.
    """

    def __init__(self, baseline_pf: Vector, design: CapacitorDesign, gain_rel: Vector) -> None:
        self.baseline_pf = baseline_pf
        self.distance_rel = design.plate_distance_um(baseline_pf) / design.gap_um / gain_rel
        untared: Mask = np.isnan(baseline_pf)
        whole_legs: Mask = np.asarray(untared.all(axis=1))
        self.untared_legs = whole_legs
        self.untared: Mask = np.logical_and(untared, ~whole_legs[:, None])
        self.whole = not self.untared.any()
