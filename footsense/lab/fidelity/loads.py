"""Loads on which fidelity levels are compared: the paper's centred loads, and loads in the mirror plane."""

from collections.abc import Sequence

import numpy as np

from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads
from footsense.lab.training.load_cases import paper_training, paper_verification


def paper_loads(response: FootResponse) -> ContactLoads:
    """Return the paper's 362 + 180 centred loads (section III F)."""
    force_n = np.concatenate([paper_training(response).force_n, paper_verification(response).force_n])
    return ContactLoads.centred(force_n)


def loads_in_mirror_plane(cases: Sequence[tuple[float, float, float]]) -> ContactLoads:
    """Return loads in the plane y = 0, for which the finite-strain model meshes half the foot.

    Args:
        cases: Elevation of the normal and of the force [deg], magnitude [gf].
    """
    normal_deg, force_deg, magnitude_gf = np.array(cases, dtype=np.float64).T
    force_n = directions(0.0, force_deg) * magnitude_gf[:, None] * GRAM_FORCE_N
    return ContactLoads(directions(0.0, normal_deg), force_n)
