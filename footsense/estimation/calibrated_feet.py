"""Estimator of calibrated feet: one network call for all feet, then each foot's stiffness and mount."""

from collections.abc import Sequence

import numpy as np

from footsense.foot.parameters import FootParameters, force_factor_and_uncertainty
from footsense.frames import Vector
from footsense.ports import LoadEstimate, LoadEstimator, Window


class CalibratedFeet:
    """Estimator that applies each foot's stiffness and mount to the network of the foot type.

    Until `set_temperature` is called, the feet are estimated as at the temperature of their calibration.

    Args:
        network: Network of the design.
        feet: Parameters of the foot of each row, None for one that is taken as designed.
        calibrated_at: Temperature of each foot's calibration [degC], NaN where it was not measured; None for a foot
            that is taken as designed. `set_temperature` alone needs it.
    """

    def __init__(
        self,
        network: LoadEstimator,
        feet: Sequence[FootParameters | None],
        calibrated_at: Sequence[float | None] = (),
    ) -> None:
        self._network = network
        self._calibrated_at = calibrated_at
        self._calibrated_matrix = np.array([foot.force_matrix if foot else np.eye(3) for foot in feet])
        self._rotation = np.array([foot.mount.T if foot else np.eye(3) for foot in feet])
        self._turned = bool((self._rotation != np.eye(3)).any())
        self._apply_temperature_factors(np.ones(len(feet)), np.zeros(len(feet)))

    def set_temperature(self, temperature_c: Vector) -> None:
        """Set the feet's present temperature [degC], shape (legs,), by which their forces are compensated.

        NaN stands for one that is not measured.
        """
        legs = zip(temperature_c.tolist(), self._calibrated_at, strict=True)
        gain, unknown_rel = np.array([force_factor_and_uncertainty(*leg) for leg in legs]).T
        self._apply_temperature_factors(gain, unknown_rel)

    def _apply_temperature_factors(self, gain: Vector, unknown_rel: Vector) -> None:
        self._matrix = gain[:, None, None] * self._calibrated_matrix
        self._unknown_rel2 = unknown_rel[:, None] ** 2

    def estimate(self, window: Window) -> LoadEstimate:
        """Return the estimated load of every row of the window, corrected by the calibrations.

        The network's sigma is rotated and scaled with the force; what an unknown temperature changes of its size is
        added. The contact is turned by the mount as the force is.
        """
        design_n, design_sigma_n, contact, contact_sigma = self._network.estimate(window)
        if self._turned:
            contact, contact_sigma = _contact_in_leg_frame(self._rotation, contact, contact_sigma)
        force_n = np.einsum("rij,rj->ri", self._matrix, design_n)
        variance_n2 = np.einsum("rij,rj->ri", self._matrix**2, design_sigma_n**2)
        variance_n2 += self._unknown_rel2 * force_n**2
        return LoadEstimate(force_n, np.sqrt(variance_n2), contact, contact_sigma)


def _contact_in_leg_frame(rotation: Vector, contact: Vector, sigma: Vector) -> tuple[Vector, Vector]:
    """Return contact coordinates and their sigma, transformed from the foot's frame to the leg's.

    Args:
        rotation: Rotation of vectors from the foot's frame to the leg's, shape (rows, 3, 3).
        contact: As in `LoadEstimate`, shape (rows, 4).
        sigma: Standard deviation of each, shape (rows, 4).
    """
    point, ratio = contact[:, :2], contact[:, 2:]
    scale = 2.0 / (1.0 + np.einsum("ri,ri->r", point, point))
    normal = np.column_stack((scale[:, None] * point, scale - 1.0))
    # The tangential force is perpendicular to the normal.
    tangent = np.column_stack((ratio, -np.einsum("ri,ri->r", normal[:, :2], ratio) / normal[:, 2]))
    turned_normal = np.einsum("rij,rj->ri", rotation, normal)
    turned_tangent = np.einsum("rij,rj->ri", rotation, tangent)
    turned_scale = 1.0 + turned_normal[:, 2]
    # Both directions of an error change places; the angle between two normals stays.
    mixed = np.einsum("rij,rkj->rki", rotation[:, :2, :2] ** 2, sigma.reshape(-1, 2, 2) ** 2)
    kept = (sigma**2).reshape(-1, 2, 2).sum(axis=2, keepdims=True) / mixed.sum(axis=2, keepdims=True)
    turned_sigma = np.sqrt(mixed * kept)
    turned_sigma[:, 0] *= (scale / turned_scale)[:, None]
    turned = np.column_stack((turned_normal[:, :2] / turned_scale[:, None], turned_tangent[:, :2]))
    return turned, turned_sigma.reshape(-1, 4)
