"""A twin of one foot: what its nine elements read under a load, as a function of what makes it differ from its design.

For element i, cells c, its readings at rest C0 and a load whose free closure the design's response knows:

    C_i = s_i + K mean_c 1 / (D_i - a_i d_c),     D_i = K / (C0_i - s_i),      K = eps0 A

with the stray s, the gain a of the closures, and closures d_c <= g_i of a solid (1 + k) times as stiff as designed,
under a load turned by the mount. The film does not appear: the distance at rest has it inside.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.foot import gap_contact
from footsense.foot.response_table import FootResponse
from footsense.frames import ELEMENTS
from footsense.sim.foot.fabrication import rotation

Vector = NDArray[np.float64]

#: Where each kind of parameter stands in a vector of them: stray [pF], gain less one [1], gap over the designed one
#: [um], stiffness over the designed one less one [1], mount as a rotation vector [rad].
STRAY, GAIN, GAP = slice(0, 9), slice(9, 18), slice(18, 27)
STIFFNESS, MOUNT = slice(27, 28), slice(28, 31)
N_PARAMETERS = 31
KINDS = {"stray": STRAY, "gain": GAIN, "gap": GAP, "stiffness": STIFFNESS, "mount": MOUNT}

#: Electrodes come no nearer than this [um]; the film is 6.3 um of air by design.
_LEAST_DISTANCE_UM = 1.0


class Load(NamedTuple):
    """Loads in the leg's frame: contact normals, shape (n, 3), and forces [N], shape (n, 3)."""

    normal: Vector
    force_n: Vector

    @classmethod
    def centred(cls, force_n: Vector) -> "Load":
        """Return loads through the centre of the ball: the normal lies along the force."""
        return cls(force_n / np.linalg.norm(force_n, axis=1, keepdims=True), force_n)


class FootTwin:
    """The twin.

    Args:
        response: How feet of its type yield.
        unloaded_pf: What each element reads at rest, stray included [pF], shape (9,).
    """

    def __init__(self, response: FootResponse, unloaded_pf: Vector) -> None:
        self._response = response
        self._unloaded_pf = unloaded_pf
        self._lowest = np.sin(np.radians(response.min_elevation_deg))

    def gap_um(self, parameters: Vector) -> Vector:
        """Return the gap of each element at rest [um], shape (9,)."""
        gap_um: Vector = self._response.design.gap_um + parameters[GAP]
        return gap_um

    def cells_um(self, parameters: Vector, load: Load) -> Vector:
        """Return the closure of each cell [um], shape (n, 324), at most its gap; of gaps, stiffness and mount alone."""
        response, mount = self._response, rotation(parameters[MOUNT])
        softness = 1.0 / (1.0 + float(parameters[STIFFNESS][0]))
        free_um = softness * response.free_closure_um(
            self._seen(load.normal @ mount.T), load.force_n @ mount.T
        )
        gap_um = np.repeat(self.gap_um(parameters), gap_contact.CELLS)
        shut = np.flatnonzero((free_um > gap_um).any(axis=1))
        compliance = softness * response.compliance_um_per_n if len(shut) else np.empty(0)
        for one in shut:
            free_um[one] = gap_contact.touch(free_um[one], gap_um, compliance).closure_um
        return free_um

    def reading_pf(self, parameters: Vector, cells_um: Vector) -> Vector:
        """Return what each element reads [pF], shape (n, 9), at closures of its cells [um], shape (n, 324)."""
        design, stray_pf = self._response.design, parameters[STRAY]
        rest_um = design.plate_distance_um(self._unloaded_pf - stray_pf)
        moved_um = cells_um * np.repeat(1.0 + parameters[GAIN], gap_contact.CELLS)
        distance_um = np.maximum(np.repeat(rest_um, gap_contact.CELLS) - moved_um, _LEAST_DISTANCE_UM)
        return gap_contact.capacitance_pf(design, distance_um) + stray_pf

    def capacitance_pf(self, parameters: Vector, load: Load) -> Vector:
        """Return what each element reads under loads [pF], shape (n, 9)."""
        return self.reading_pf(parameters, self.cells_um(parameters, load))

    def possible(self, parameters: Vector) -> Vector:
        """Return the nearest parameters that a foot can have: capacitance beside the strays, gaps, and stiffness."""
        kept = parameters.copy()
        kept[STRAY] = np.minimum(kept[STRAY], 0.5 * self._unloaded_pf)
        kept[GAIN] = np.clip(kept[GAIN], -0.5, 1.0)
        kept[GAP] = np.maximum(kept[GAP], -0.9 * self._response.design.gap_um)
        kept[STIFFNESS] = np.clip(kept[STIFFNESS], -0.95, 20.0)
        return kept

    def _seen(self, normal: Vector) -> Vector:
        """Return normals, those below the known response lifted to its rim."""
        low = normal[:, 2] < self._lowest
        if not low.any():
            return normal
        lifted = normal.copy()
        across = normal[low, :2] / np.linalg.norm(normal[low, :2], axis=1, keepdims=True)
        lifted[low, :2] = np.sqrt(1.0 - self._lowest**2) * across
        lifted[low, 2] = self._lowest
        return lifted


def unchanged() -> Vector:
    """Return the parameters of a foot as designed, shape (N_PARAMETERS,)."""
    return np.zeros(N_PARAMETERS)


def names() -> list[str]:
    """Return the name of each parameter with its element and unit, for people."""
    kinds = [("stray", "pF"), ("gain", "1"), ("gap", "um")]
    nines = [f"{kind} of element {element} [{unit}]" for kind, unit in kinds for element in range(ELEMENTS)]
    return [*nines, "stiffness [1]", *(f"mount about {axis} [rad]" for axis in "xyz")]
