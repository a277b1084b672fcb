"""What nobody knows of a foot that is not calibrated, by the tolerances of its manufacture, or has worn since.

A stray capacitance s in parallel with an element of capacitance C changes its closure, which is computed from 1 / C, by
the share 2 s / C, as a gain does; the closures of all elements go through the network, the stiffness of the rubber
changes the size of the force, and the mounting turns it. Deviations of gaps and films change no force as long as no gap
closes.
"""

import math
from itertools import product

import numpy as np

from footsense.estimation.network import Network, steady_windows
from footsense.foot.directions import angles_between_deg, normalized
from footsense.foot.parameters import KNOWN_EXACTLY, ForceUncertainty
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import ELEMENTS, Vector
from footsense.sim.fabrication import PAPER_TOLERANCES, SESSION_GAIN_REL, FootTolerances

#: Loads of which the errors are the mean: half of the largest that all elements read, upright and leaning 27 deg.
_DIRECTIONS: Vector = normalized(
    np.array([[x, y, 1.0] for x, y in ((0, 0), (0.5, 0), (-0.5, 0), (0, 0.5), (0, -0.5))])
)
#: Normals of the ground under a leg that leans half as far as its load: a stick presses along the load.
_GROUND_NORMALS: Vector = normalized(np.add(_DIRECTIONS, [0.0, 0.0, 1.0]))


def uncertainty_of_uncalibrated(
    network: Network,
    response: FootResponse,
    n_rows: int,
    tolerances: FootTolerances = PAPER_TOLERANCES,
    gain_rel: float = 0.0,
) -> ForceUncertainty:
    """Return what nobody knows of a foot that is not calibrated, by the tolerances of its manufacture.

    Args:
        network: Network of its type.
        response: Response of its type.
        n_rows: Rows that the network estimates at once.
        tolerances: Those of its manufacture.
        gain_rel: Rms change of the gain of each element since [1].
    """
    design = response.design
    share_rel = math.hypot(2.0 * tolerances.stray_pf / design.unloaded_pf, gain_rel)
    along_rel, across_rel = _by_gains(network, response, n_rows, share_rel, _DIRECTIONS)
    along_rel = math.hypot(along_rel, tolerances.stiffness_rel)
    across_rel = math.hypot(across_rel, math.radians(tolerances.mount_deg) / math.sqrt(3.0))
    return ForceUncertainty(round(along_rel, 4), round(across_rel, 4), tolerances.gap_um / design.gap_um)


def uncertainty_by_wear(network: Network, response: FootResponse | None, n_rows: int) -> ForceUncertainty:
    """Return what nobody knows of a foot since its calibration: the gains of its elements in another session.

    Args:
        network: Network of its type.
        response: Response of its type; nothing is told without it.
        n_rows: Rows that the network estimates at once.
    """
    if response is None:
        return KNOWN_EXACTLY
    along_rel, across_rel = _by_gains(network, response, n_rows, SESSION_GAIN_REL, _GROUND_NORMALS)
    return ForceUncertainty(round(along_rel, 4), round(across_rel, 4))


def _by_gains(
    network: Network, response: FootResponse, n_rows: int, gain_rel: float, normal: Vector
) -> tuple[float, float]:
    """Return what gains off by a standard deviation make uncertain of loads with these contact normals.

    Along and across the force; to be rounded, as a network of other rows differs in the last bits.
    """
    foot, design = Specimen(response), response.design
    trained = network.card.trained_inputs
    largest_rel = trained.closure_rel_max
    force_n = 0.5 * trained.max_force_n * _DIRECTIONS
    while True:
        free_um, loaded_um = map(
            design.plate_distance_um, (foot.unloaded_pf, foot.capacitance_pf(normal, force_n))
        )
        closure_rel: Vector = (free_um - loaded_um) / design.gap_um
        if (closure_rel <= 0.5 * largest_rel).all():
            break
        force_n = 0.5 * force_n
    # Every combination of elements that are off, each by a standard deviation to either side.
    gains = 1.0 + gain_rel * np.array(list(product((-1.0, 1.0), repeat=ELEMENTS)))
    estimated_n = np.array(
        [_estimated_n(network, n_rows, closures_rel * gains) for closures_rel in closure_rel]
    )
    sizes_n = np.linalg.norm(estimated_n, axis=2)
    angles_deg = angles_between_deg(estimated_n.reshape(-1, 3), np.repeat(force_n, len(gains), axis=0))
    off_rel = sizes_n / np.linalg.norm(force_n, axis=1)[:, None] - 1.0
    across_rel = math.sqrt(float(np.square(np.radians(angles_deg)).mean()) / 2.0)
    return float(off_rel.std()), across_rel


def _estimated_n(network: Network, n_rows: int, closure_rel: Vector) -> Vector:
    """Return the forces of closures at rest [N], shape (n, 3), by a network of so many rows."""
    padded = np.resize(closure_rel, (-(-len(closure_rel) // n_rows) * n_rows, ELEMENTS))
    forces_n = [
        network.estimate(steady_windows(rows)).force_n for rows in padded.reshape(-1, n_rows, ELEMENTS)
    ]
    return np.concatenate(forces_n)[: len(closure_rel)]
