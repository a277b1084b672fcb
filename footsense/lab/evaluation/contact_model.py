"""Measurement model: closures and forces as functions of five contact coordinates, with Jacobians.

The coordinates of a load are its normal force s [N], the friction ratio (tangential over normal force, forward and to
the left) and the stereographic contact point (normal_x, normal_y) / (1 + normal_z). Derivatives are differences.
"""

import numpy as np

from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import Mask, Vector
from footsense.lab.training.gait_windows import contact_and_normal_force
from footsense.lab.training.load_cases import BASELINE_NOISE_PF, FULL_SCALE_PF, NOISE_PF, sensed_closure_um

#: Number of coordinates, and where friction ratio and contact point are.
COORDINATES, RATIO, POINT = 5, slice(1, 3), slice(3, 5)
#: Bounds of the normal force [N], and of the lengths of friction ratio and contact point [1].
MIN_NORMAL_FORCE_N, _MOST_N, _MOST_RATIO, _MOST_POINT = 2e-3, 2.5, 0.8, 0.5
#: Differences: of the normal force over itself, of friction ratio and contact point [1].
_FINITE_DIFFERENCE_STEPS = np.array([0.02, 0.01, 0.01, 0.005, 0.005])
#: Error of the response itself over the closure, and distance of a valid closure from full scale over the gap [1].
_MODEL_REL, _FULL_MARGIN_REL = 1e-3, 1e-3


def normals_of_stereographic_points(point: Vector) -> Vector:
    """Return the unit contact normals, shape (n, 3), of stereographic contact points, shape (n, 2)."""
    square = (point**2).sum(axis=1, keepdims=True)
    normal: Vector = np.hstack([2.0 * point, 1.0 - square]) / (1.0 + square)
    return normal


def clip_to_coordinate_bounds(coordinates: Vector) -> Vector:
    """Return the contact coordinates clipped to the constant bounds of this module, shape (n, 5)."""
    inside = coordinates.copy()
    inside[:, 0] = np.clip(coordinates[:, 0], MIN_NORMAL_FORCE_N, _MOST_N)
    for part, most in ((RATIO, _MOST_RATIO), (POINT, _MOST_POINT)):
        length = np.linalg.norm(inside[:, part], axis=1, keepdims=True)
        inside[:, part] *= np.minimum(1.0, most / np.maximum(length, most))
    return inside


def contact_coordinates_of(force_n: Vector, contact: Vector) -> Vector:
    """Return contact coordinates (n, 5), clipped, from forces [N] and `LoadEstimate.contact_point_and_friction`."""
    _, pressing_n = contact_and_normal_force(force_n, normals_of_stereographic_points(contact[:, :2]))
    return clip_to_coordinate_bounds(np.column_stack([pressing_n, contact[:, 2:], contact[:, :2]]))


def force_and_slopes(coordinates: Vector) -> tuple[Vector, Vector]:
    """Return forces [N], shape (n, 3), and their Jacobian by the contact coordinates, shape (n, 3, 5)."""
    ratio, point = coordinates[:, RATIO], coordinates[:, POINT]
    normal = normals_of_stereographic_points(point)
    unit = _force_per_normal_force(ratio, point)
    pressing_n = coordinates[:, :1]
    slopes = np.zeros((len(unit), 3, COORDINATES))
    slopes[:, :, 0] = unit
    slopes[:, [0, 1], [1, 2]] = pressing_n
    slopes[:, 2, RATIO] = -pressing_n * normal[:, :2] / normal[:, 2:]
    for axis in range(2):
        step = 1e-5 * np.eye(2)[axis]
        slopes[:, :, 3 + axis] = pressing_n * (_force_per_normal_force(ratio, point + step) - unit) / 1e-5
    return pressing_n * unit, slopes


def _force_per_normal_force(ratio: Vector, point: Vector) -> Vector:
    """Return force over normal force [1], shape (n, 3); friction acts perpendicular to the normal."""
    normal = normals_of_stereographic_points(point)
    along = -(normal[:, :2] * ratio).sum(axis=1, keepdims=True) / normal[:, 2:]
    force: Vector = normal + np.hstack([ratio, along])
    return force


class ContactMeasurementModel:
    """Measurement model of the designed foot: closures from contact coordinates.

    Args:
        response: Response of its type.
    """

    def __init__(self, response: FootResponse) -> None:
        self._foot = Foot(response)
        self._design = response.design
        full_um = response.design.closure_um(np.array(FULL_SCALE_PF), np.array(response.design.unloaded_pf))
        self._full_rel = float(full_um) / response.design.gap_um - _FULL_MARGIN_REL

    def closure_and_slopes(self, coordinates: Vector) -> tuple[Vector, Vector]:
        """Return closures over the gap [1], shape (n, 9), and their Jacobian, shape (n, 9, 5)."""
        steps = _FINITE_DIFFERENCE_STEPS * np.ones_like(coordinates)
        steps[:, 0] *= coordinates[:, 0]
        changed = [coordinates, *(coordinates - steps * one for one in np.eye(COORDINATES))]
        every = np.concatenate(changed)
        normal = normals_of_stereographic_points(every[:, POINT])
        force_n = every[:, :1] * _force_per_normal_force(every[:, RATIO], every[:, POINT])
        closure_um = sensed_closure_um(self._foot, normal, force_n)
        closure_rel = (closure_um / self._design.gap_um).reshape(len(changed), len(coordinates), -1)
        slopes = (closure_rel[0] - closure_rel[1:]).transpose(1, 2, 0) / steps[:, None]
        return closure_rel[0], slopes

    def closure_sigma_rel(self, closure_rel: Vector) -> Vector:
        """Return the standard deviation of measured closures [1], same shape: noise and model error."""
        design = self._design
        distance_um = design.gap_um * (1.0 - closure_rel) + design.film_equivalent_um
        unloaded_um = design.gap_um + design.film_equivalent_um
        noise_rel = np.hypot(NOISE_PF, BASELINE_NOISE_PF) / design.unloaded_pf / design.gap_um
        sigma: Vector = np.hypot(noise_rel * distance_um**2 / unloaded_um, _MODEL_REL * closure_rel)
        return sigma

    def is_in_converter_range(self, closure_rel: Vector) -> Mask:
        """Return which measured closures are within the converter's range, same shape."""
        within: Mask = closure_rel < self._full_rel
        return within
