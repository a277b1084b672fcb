"""What every rung is asked, and what it hands back."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What the elements do under some loads.

    Attributes:
        closure_um: Mean closure of each gap [um], shape (n, 9).
        capacitance_pf: Capacitance of each element without stray [pF], shape (n, 9).
    """

    closure_um: NDArray[np.float64]
    capacitance_pf: NDArray[np.float64]


class Rung(Protocol):
    """A model of the foot.

    Attributes:
        name: What it is asked for by.
    """

    name: str

    def answer(self, normal: NDArray[np.float64], force_n: NDArray[np.float64]) -> Answer:
        """Return what the elements do.

        Args:
            normal: Inward unit normals of the ball at the contacts [1, foot frame], shape (n, 3).
            force_n: Ground reactions on the foot [N, foot frame], shape (n, 3).

        Returns:
            The answer.

        Raises:
            ValueError: A load is none that this rung can answer for.
        """
        ...
