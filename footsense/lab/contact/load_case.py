"""Load case of the finite-strain contact model: foot, contact normal, force, and quantities known before solving."""

from dataclasses import dataclass

import numpy as np

from footsense.frames import Vector
from footsense.lab.geometry import FootDesign

#: A unit vector may be this far from length one.
UNIT_LENGTH_TOLERANCE = 1e-6
#: A component below this share of the vector counts as none.
IN_PLANE_TOLERANCE = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class LoadCase:
    """Load case of one foot: contact normal, ground reaction force [N] and friction coefficient.

    Attributes:
        design: The foot.
        normal: Unit normal of the ball at the contact, pointing into the ball [1, foot frame], shape (3,).
        force_n: Ground reaction on the foot [N, foot frame], shape (3,).
        friction: Coulomb's coefficient mu [1].
    """

    design: FootDesign
    normal: Vector
    force_n: Vector
    friction: float

    def __post_init__(self) -> None:
        """Check that the force is inside the friction cone and within range.

        Raises:
            ValueError: The normal is no unit vector, or the force is outside the cone of friction around it.
        """
        if not abs(np.linalg.norm(self.normal) - 1.0) <= UNIT_LENGTH_TOLERANCE:
            raise ValueError(f"a contact normal has length 1, got {np.linalg.norm(self.normal):g}")
        along = float(np.linalg.norm(self.force_n - self.normal_force_n * self.normal))
        if not (self.normal_force_n > 0.0 and along < self.friction * self.normal_force_n):
            raise ValueError(
                f"a floor of friction {self.friction:g} that is pressed with {self.normal_force_n:g} N holds less than "
                f"{max(self.friction * self.normal_force_n, 0.0):g} N along itself, got {along:g} N"
            )

    @property
    def normal_force_n(self) -> float:
        """Force along the normal [N]."""
        return float(self.normal @ self.force_n)

    @property
    def is_mirrored_at_y0(self) -> bool:
        """Whether the load case is symmetric about the plane y = 0."""
        return bool(
            abs(self.normal[1]) < IN_PLANE_TOLERANCE
            and abs(self.force_n[1]) < IN_PLANE_TOLERANCE * np.linalg.norm(self.force_n)
        )

    @property
    def meshed_share(self) -> float:
        """Share of the foot that is meshed [1]: half with a mirror plane, else all."""
        return 0.5 if self.is_mirrored_at_y0 else 1.0

    @property
    def floor_axes(self) -> tuple[int, ...]:
        """Indices of the axes along which the floor may move; y is left out in a mirrored load case."""
        return (0, 2) if self.is_mirrored_at_y0 else (0, 1, 2)

    @property
    def touch_point_mm(self) -> Vector:
        """Point at which the floor touches the unloaded ball [mm], shape (3,)."""
        return self.design.touch_point_mm(self.normal)

    @property
    def hertz_radius_mm(self) -> float:
        """Radius of the Hertz patch on a rigid plane [mm]: a^3 = 3 f.n R / (4 E*)."""
        return self.design.hertz_patch_radius_mm(self.normal_force_n)
