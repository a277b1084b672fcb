"""Effects of temperature on a simulated foot: baseline drift per element, and stiffer rubber."""

import numpy as np

from footsense.frames import ELEMENTS
from footsense.sim.scene import Warming

#: Thermal expansion of the spacer, 310 ppm/K, on an element of 5 pF [pF/K].
DRIFT_PF_PER_K = -1.5e-3
#: Standard deviation between the elements of a foot [1].
DRIFT_SPREAD_REL = 0.2
#: Shear modulus of PDMS, 1.1 kPa/K of 250 kPa (Lotters 1997) [1/K].
STIFFENING_PER_K = 4.4e-3


def relative_compliance_when_warmed(kelvin: float) -> float:
    """Return the factor on the gap closures under the same load, for a foot warmed by `kelvin` [1].

    Args:
        kelvin: Change of temperature [K].
    """
    return 1.0 / (1.0 + STIFFENING_PER_K * kelvin)


class WarmingFoot:
    """Temperature change of one foot over time, with its baseline drift and stiffening.

    Args:
        warming: The change.
        rng: Source of the differences between its elements.
    """

    def __init__(self, warming: Warming, rng: np.random.Generator) -> None:
        self._warming = warming
        spread_rel = DRIFT_SPREAD_REL * rng.standard_normal(ELEMENTS)
        self._pf_per_k: list[float] = (DRIFT_PF_PER_K * (1.0 + spread_rel)).tolist()

    def drift_pf(self, t_ns: int) -> list[float]:
        """Return the baseline drift of each element at a time [pF]."""
        kelvin = self._warming.temperature_change_k_at(t_ns)
        return [pf_per_k * kelvin for pf_per_k in self._pf_per_k]

    def relative_compliance(self, t_ns: int) -> float:
        """Return the factor on the gap closures under the same load at a time [1]; 1 at the start."""
        return relative_compliance_when_warmed(self._warming.temperature_change_k_at(t_ns))
