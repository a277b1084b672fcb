"""Protocol of a ground model: traction on the ball, load steps and contact patch."""

from dataclasses import dataclass
from typing import Any, Protocol

#: The face that a floor touches.
GROUND_FACE = "curved_ground"


@dataclass(frozen=True, slots=True)
class ContactPatch:
    """Radius [mm], approach [mm] and peak pressure [MPa] of the contact between floor and ball.

    Attributes:
        radius_mm: Radius of the circle with the area of the touching surface, undeformed [mm].
        approach_mm: Travel of the floor along the normal since it touched [mm].
        peak_pressure_mpa: Largest pressure per undeformed area [MPa], of its projection on linear elements.
    """

    radius_mm: float
    approach_mm: float
    peak_pressure_mpa: float


class FloorModel(Protocol):
    """Ground model that the equilibrium solver uses: traction, load fraction and contact patch.

    Attributes:
        target_n: Prescribed force on the meshed part [N], a parameter of the weak form for each free axis.
    """

    target_n: list[Any]

    def virtual_work(self, u: Any, v: Any) -> Any:
        """Return the floor's virtual work; u is the displacement relative to the floor, v the test function."""

    def set_load_fraction(self, fraction: float) -> None:
        """Set the prescribed fraction of the load case's force [1], and predict the matching floor position."""

    def accept_load_step(self) -> None:
        """Store the present displacements as the start of the next load step."""

    def patch(self) -> ContactPatch:
        """Return radius, approach and peak pressure of the current contact patch."""
