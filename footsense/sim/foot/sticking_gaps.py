"""Stiction of one simulated foot's gaps: a closed gap stays closed until the rubber pulls it open.

The paper lines its cavities with parylene against this, and names a film without gaps as the cure (section VI). How
much a pair of surfaces bears is measured on no foot: soft polymers bear between one and some hundred kilopascals. The
plates of the released foot pull a fully closed element open with some 13 to 30 kPa.
"""

import numpy as np

from footsense.foot.gap_contact import N_CELLS
from footsense.foot.specimen import Foot
from footsense.frames import Vector


class StickingGaps:
    """Closed or open state of the gaps of one vented foot, advanced load by load.

    Args:
        foot: The foot.
        stiction_kpa: Largest pull on a closed cell over its area [kPa].
    """

    def __init__(self, foot: Foot, stiction_kpa: float) -> None:
        self._foot = foot
        self._stiction_kpa = stiction_kpa
        self._stuck = np.zeros(N_CELLS, bool)

    def next_capacitance_pf(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the capacitance of each element under the next load [pF], shape (elements,); updates which stick.

        Args:
            normal: Inward normal of the contact, shape (3,).
            force_n: Load [N], shape (3,).
        """
        capacitance_pf, self._stuck = self._foot.capacitance_with_stiction(
            normal, force_n, self._stuck, self._stiction_kpa
        )
        return capacitance_pf
