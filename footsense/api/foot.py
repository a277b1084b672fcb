"""A foot type as a model: forces to capacitances, `footsense.Foot`."""

import numpy as np
from numpy.typing import ArrayLike

from footsense.foot.directions import normalized
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.foot.type_folders import foot_type_folder
from footsense.frames import ELEMENTS, Vector


class Foot:
    """Model of a foot exactly as designed: capacitances under a contact force, at rest and without noise.

    Args:
        foot_type: A released foot type, such as `aoyagi-3x3`, `hexapod-2kg` or `quadruped-12kg`; or, with a slash, the
            folder of another from `footsense lab build`.

    Attributes:
        foot_type: Name of the foot type.
        unloaded_pf: Capacitance of each element of the free foot [pF], shape (9,).

    Raises:
        ModelError: There is no such foot type.

    Example:
        >>> foot = Foot("aoyagi-3x3")
        >>> foot.capacitance_pf([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).round(2)[:, :3].tolist()
        [[5.39, 5.39, 5.39], [8.17, 7.62, 8.17]]
    """

    def __init__(self, foot_type: str = "aoyagi-3x3") -> None:
        response = FootResponse.load(foot_type_folder(foot_type) / "response.npz")
        self._specimen = Specimen(response)
        self.foot_type = response.foot_type
        self.unloaded_pf = self._specimen.unloaded_pf

    def capacitance_pf(self, force_n: ArrayLike, normal: ArrayLike | None = None) -> Vector:
        """Return the capacitance of each element under forces [pF].

        Element 3 * row + column, row 0 the most forward, column 0 the leftmost. A gap that closes carries load.

        Args:
            force_n: Ground reaction on the foot in the foot's frame: x forward, y left, z along the leg towards the
                body [N], shape (..., 3); zero for a foot in the air.
            normal: Normal of the ground into the foot, which also says where the ball touches [1], a shape that
                broadcasts with that of the forces; any length but 0. None for forces through the middle of the ball:
                the normal is along the force.

        Returns:
            Capacitances without stray [pF], shape (..., 9).

        Raises:
            ValueError: The last axis has not three components, a number is not finite, a normal has no length, or leans
                further than the model reaches.
        """
        force = _vectors(force_n, "force_n")
        if normal is None:
            # Of the largest component first: the square of a tiny one is 0.
            largest = np.abs(force).max(axis=-1, keepdims=True)
            in_the_air = largest == 0.0
            normals = normalized(
                np.where(in_the_air, (0.0, 0.0, 1.0), force / np.where(in_the_air, 1.0, largest))
            )
        else:
            normals = _vectors(normal, "normal")
            length = np.linalg.norm(normals, axis=-1, keepdims=True)
            if not (length > 0.0).all():
                raise ValueError("normal: one has no length")
            normals = normals / length
        force, normals = np.broadcast_arrays(force, normals)
        shape = force.shape[:-1]
        pf = self._specimen.capacitance_pf(normals.reshape(-1, 3), force.reshape(-1, 3))
        return pf.reshape(*shape, ELEMENTS)


def _vectors(values: ArrayLike, name: str) -> Vector:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"{name}: its last axis has the three components x, y, z; got shape {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: has a number that is not finite")
    return array
