"""Mean closures of many feet under a few loads, and their derivatives by force and contact, without gap contact.

Per load: direction of the force, contact normal. In the units of the solved feet (10 mm, 5.2 MPa) a foot's closure is

    d = s |f| [w0 + a^2 w2] . f / |f|,      s = A (5.2 / E) (10 / R)
    a^2 = 100 (3/4 (1 - nu^2) |f . n| / (E R^2))^(2/3)

with w0, w2 and their slopes by the normal the weighted sum of those of the solved shapes.
"""

from typing import NamedTuple

import numpy as np

from footsense.foot.directions import normalized, tangent_frame
from footsense.foot.gap_contact import element_means
from footsense.foot.response_table import series_basis, whole_series
from footsense.frames import ELEMENTS, Vector
from footsense.lab.design.candidates import Candidates
from footsense.lab.design.shapes import (
    AMPLITUDE_INDEX_OF_ELEMENT,
    RADIUS_MM,
    RUBBER_POISSON,
    YOUNGS_MPA,
    FootShapeLibrary,
)
from footsense.lab.evaluation.force_range import LoadDirections
from footsense.lab.geometry import MIN_FITTED_ELEVATION_DEG

#: Step of the differences by the normal [rad], and degree of the series.
_STEP, _DEGREE = 1e-3, 12


class Influence(NamedTuple):
    """Closure per newton of n feet under m loads, by element [um/N].

    Attributes:
        point_force_um_per_n: Of a point force, and its slopes by two turns of the normal [um/N], shape (n, m, 3, 3, 9).
        patch_correction_um_per_n: The same of the contact patch, for (F/N)^(2/3) = 1 [um/N].
    """

    point_force_um_per_n: Vector
    patch_correction_um_per_n: Vector


class ClosureModel:
    """Closures of candidate feet under given loads, interpolated from the shape library.

    Args:
        library: The solved shapes.
        loads: The loads.

    Attributes:
        loads: The loads.
        unevenness: Variance of an electrode's cell closures over their squared mean, paper's shape, shape (m, 9).
    """

    def __init__(self, library: FootShapeLibrary, loads: LoadDirections) -> None:
        """Create the model: evaluate the solved shapes at the loads."""
        self._library, self.loads = library, loads
        self._across = np.stack(tangent_frame(loads.normal), axis=1)
        whole = [[whole_series(part, _DEGREE) for part in shape] for shape in library.series]
        # shapes, point or patch, products, xyz, elements
        series = element_means(np.moveaxis(np.array(whole), -1, -2))
        basis = self._basis()
        self._at = basis @ series.reshape(*series.shape[:3], -1)
        cells = np.einsum("mp,pec,mc->me", basis[: len(loads.normal)], whole[0][0], loads.direction)
        cells = cells.reshape(len(cells), ELEMENTS, -1)
        self.unevenness = cells.var(axis=2) / cells.mean(axis=2) ** 2

    def _basis(self) -> Vector:
        """Return the response series' products at the normals, and their derivatives, (3 loads, products)."""
        normal = self.loads.normal
        rows = [series_basis(normal, _DEGREE, MIN_FITTED_ELEVATION_DEG)]
        for turn in range(2):
            ahead, behind = (
                series_basis(
                    normalized(normal + sign * _STEP * self._across[:, turn]),
                    _DEGREE,
                    MIN_FITTED_ELEVATION_DEG,
                )
                for sign in (1.0, -1.0)
            )
            rows.append((ahead - behind) / (2.0 * _STEP))
        return np.concatenate(rows)

    def influence(self, feet: Candidates) -> Influence:
        """Return the closures per newton of a batch of feet (12 kB of memory each)."""
        weights = self._library.interpolation_weights(feet.shape)
        amplitudes = self._library.interpolated_response_amplitudes_um_per_n(weights)
        amplitude = amplitudes[:, AMPLITUDE_INDEX_OF_ELEMENT]
        size = RADIUS_MM / feet.ball_radius_mm
        relative_compliance = (YOUNGS_MPA / feet.rubber_mpa) * size
        m = len(self.loads.normal)
        whole = (weights * relative_compliance[:, None]) @ self._at.reshape(len(self._at), -1)
        whole = whole.reshape(len(weights), 2, 3, m, 3, ELEMENTS).swapaxes(2, 3)
        whole = whole * amplitude[:, None, None, None, None, :]
        patch_rel2 = (0.75 * (1.0 - RUBBER_POISSON**2) / (feet.rubber_mpa * feet.ball_radius_mm**2)) ** (
            2.0 / 3.0
        )
        return Influence(whole[:, 0], RADIUS_MM**2 * patch_rel2[:, None, None, None, None] * whole[:, 1])

    def closures_and_jacobian_um(self, influence: Influence, force_n: Vector) -> tuple[Vector, Vector]:
        """Return closures [um], (n, m, 9), and their derivatives by the unknowns, (n, m, 9, 5).

        Args:
            influence: Of the feet.
            force_n: Magnitude of each load [N], shape (n, m).

        Returns:
            The slopes are by the force's components over its magnitude [um], then by two turns of the normal [um/rad].
        """
        direction, normal = self.loads
        pressing = (direction * normal).sum(axis=1)
        grown = (force_n * pressing) ** (2.0 / 3.0)
        unit = (
            influence.point_force_um_per_n
            + grown[:, :, None, None, None] * influence.patch_correction_um_per_n
        )
        # per newton, by force component, at the normal and its turns: shape (n, m, 3 turns, 9)
        along = np.einsum("nmtce,mc->nmte", unit, direction)
        patch = np.einsum("nmce,mc->nme", influence.patch_correction_um_per_n[:, :, 0], direction)
        closure = force_n[..., None] * along[:, :, 0]
        # The patch grows with the pressing force: d(p^(2/3)) = 2/3 p^(2/3) dp / p.
        growth = (2.0 / 3.0) * grown[..., None] * patch / pressing[:, None]
        by_force = unit[:, :, 0] + growth[:, :, None, :] * normal[:, :, None]
        leaning = np.einsum("mtc,mc->mt", self._across, direction)
        by_normal = along[:, :, 1:] + growth[:, :, None, :] * leaning[:, :, None]
        slopes = np.concatenate([by_force, by_normal], axis=2) * force_n[..., None, None]
        return closure, np.moveaxis(slopes, 2, 3)
