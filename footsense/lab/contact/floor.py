"""Protocol of a ground model: traction, load steps, contact patch."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

#: The face that a floor touches.
FACE = "curved_ground"


@dataclass(frozen=True, slots=True)
class Patch:
    """The contact patch.

    Attributes:
        radius_mm: Radius of the circle with the area of the touching surface, undeformed [mm].
        approach_mm: Travel of the floor along the normal since it touched [mm].
        peak_mpa: Largest pressure per undeformed area [MPa], of its projection on linear elements.
    """

    radius_mm: float
    approach_mm: float
    peak_mpa: float


class Floor(Protocol):
    """Ground model that the equilibrium solver uses.

    Attributes:
        axes: Directions in which the floor is free and its force is prescribed.
        target_n: That force on the meshed part [N], shape (len(axes),).
    """

    axes: tuple[int, ...]
    target_n: NDArray[np.float64]

    def work(self, u: Any, v: Any) -> Any:
        """Return the work of the floor's traction under the displacement u along v, an integral."""

    def aim(self, fraction: float) -> None:
        """Prescribe this fraction of the force, and move to the position that probably exerts it."""

    def move(self, step_mm: NDArray[np.float64]) -> None:
        """Move by a step [mm], shape (len(axes),)."""

    def settle(self) -> None:
        """Take the present state as the start of the next load step."""

    def withdraw(self) -> None:
        """Go back to the last settled state."""

    def patch(self) -> Patch:
        """Return the present contact patch."""
