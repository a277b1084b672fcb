"""The rungs by name, cheapest first; those that stand on the response table or on the full solve are here.

- `half-space`: a formula.
- `linear`: the table. Gaps cannot shut: closures may exceed the gap, only the capacitance knows the limit.
- `contact`: the table, and gaps that shut carry load. What simulator and training use.
- `full`: finite strain, a floor with friction, gaps that shut; half a minute and more per load.
"""

import numpy as np
from numpy.typing import NDArray

from footsense.foot.gap_contact import capacitance_pf, element_means
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.lab.fidelity.answer import Answer, Rung
from footsense.lab.fidelity.half_space import HalfSpace
from footsense.lab.geometry import FootDesign

Vector = NDArray[np.float64]

#: Cheapest first.
NAMES = ("half-space", "linear", "contact", "full")


class Linear:
    """The response table alone.

    Args:
        response: The table.

    Attributes:
        name: Of the rung.
    """

    name = "linear"

    def __init__(self, response: FootResponse) -> None:
        self._response = response

    def answer(self, normal: Vector, force_n: Vector) -> Answer:
        """Return closures, which may exceed the gap, and the capacitance of cells that are held at it."""
        design = self._response.design
        cells_um = self._response.free_closure_um(normal, force_n)
        distance_um = np.maximum(design.gap_um - cells_um, 0.0) + design.film_equivalent_um
        return Answer(element_means(cells_um), capacitance_pf(design, distance_um))


class GapContact:
    """The response table with gaps that carry load once they shut.

    Args:
        response: The table.

    Attributes:
        name: Of the rung.
    """

    name = "contact"

    def __init__(self, response: FootResponse) -> None:
        self._foot = Foot(response)

    def answer(self, normal: Vector, force_n: Vector) -> Answer:
        """Return what the simulated foot does."""
        design = self._foot.response.design
        cells_um = self._foot.cells_um(normal, force_n)
        distance_um = design.gap_um - cells_um + design.film_equivalent_um
        return Answer(element_means(cells_um), capacitance_pf(design, distance_um))


class Full:
    """The foot at finite strain on a floor with friction, one nonlinear solve per load.

    Args:
        foot_design: The foot.
        reduced: Whether to leave out what the rungs below leave out (small strain, Hertz's patch instead of the floor):
            what then remains to the rung `contact` is the difference of two meshes.

    Attributes:
        name: Of the rung.
    """

    name = "full"

    def __init__(self, foot_design: FootDesign, *, reduced: bool = False) -> None:
        # Here, and not above: the finite element library takes a second to load.
        from footsense.lab.contact.full_solve import FullFoot

        if reduced:
            self._foot = FullFoot(foot_design, finite_strain=False, floor="hertz", load_steps=1)
        else:
            self._foot = FullFoot(foot_design)

    def answer(self, normal: Vector, force_n: Vector) -> Answer:
        """Return one solve per load.

        Raises:
            ValueError: A force is outside the cone of friction around its normal.
        """
        solutions = [self._foot.solve(*load) for load in zip(normal, force_n, strict=True)]
        return Answer(
            np.stack([solution.closure_um for solution in solutions]),
            np.stack([solution.capacitance_pf for solution in solutions]),
        )


def rung(name: str, response: FootResponse, foot_design: FootDesign) -> Rung:
    """Return a rung.

    Args:
        name: One of `NAMES`.
        response: The foot's response table.
        foot_design: The foot that the table is of.

    Raises:
        ValueError: There is no such rung.
    """
    match name:
        case "half-space":
            return HalfSpace(foot_design)
        case "linear":
            return Linear(response)
        case "contact":
            return GapContact(response)
        case "full":
            return Full(foot_design)
        case _:
            raise ValueError(f"no rung {name!r}; there are {', '.join(NAMES)}")
