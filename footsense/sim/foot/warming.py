"""What a change of temperature does to a foot: every zero drifts a little differently, and the rubber stiffens."""

import numpy as np

from footsense.frames import ELEMENTS
from footsense.sim.scene import Warming

#: The spacer grows by 310 ppm/K: an element of 5 pF loses as much [pF/K].
DRIFT_PF_PER_K = -1.5e-3
#: How much the elements of one foot differ in that [1].
DRIFT_SPREAD_REL = 0.2
#: Shear modulus of PDMS, 1.1 kPa/K of 250 kPa (Lotters 1997) [1/K].
STIFFENING_PER_K = 4.4e-3


def softness_at(kelvin: float) -> float:
    """Return the closures of a foot that is warmer over those before, under the same load [1]."""
    return 1.0 / (1.0 + STIFFENING_PER_K * kelvin)


class WarmingFoot:
    """One foot whose temperature changes.

    Args:
        warming: How.
        rng: Of how its elements differ.
    """

    def __init__(self, warming: Warming, rng: np.random.Generator) -> None:
        self._warming = warming
        spread_rel = DRIFT_SPREAD_REL * rng.standard_normal(ELEMENTS)
        self._pf_per_k: list[float] = (DRIFT_PF_PER_K * (1.0 + spread_rel)).tolist()

    def drift_pf(self, t_ns: int) -> list[float]:
        """Return what the elements have drifted by [pF], nine."""
        kelvin = self._warming.kelvin_at(t_ns)
        return [pf_per_k * kelvin for pf_per_k in self._pf_per_k]

    def softness(self, t_ns: int) -> float:
        """Return the closures of the foot over those that it had at the beginning, under the same load [1]."""
        return softness_at(self._warming.kelvin_at(t_ns))
