"""What nobody knows of a foot that is not calibrated, by the tolerances of its manufacture.

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
from footsense.foot.parameters import ForceUncertainty
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads, Specimen
from footsense.frames import ELEMENTS, Vector
from footsense.sim.fabrication import PAPER_TOLERANCES, FootTolerances

#: Loads of which the errors are the mean: half of the largest that all elements read, upright and leaning 27 deg.
_DIRECTIONS: Vector = normalized(
    np.array([[x, y, 1.0] for x, y in ((0, 0), (0.5, 0), (-0.5, 0), (0, 0.5), (0, -0.5))])
)


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
    foot, design = Specimen(response), response.design
    share_rel = np.hypot(2.0 * tolerances.stray_pf / design.unloaded_pf, gain_rel)
    trained = network.card.trained_inputs
    largest_rel = trained.closure_rel_max
    force_n = 0.5 * trained.max_force_n * _DIRECTIONS
    while True:
        loads = ContactLoads.centred(force_n)
        free_um, loaded_um = map(
            design.plate_distance_um, (foot.unloaded_pf, foot.capacitance_pf(loads.normal, loads.force_n))
        )
        closure_rel: Vector = (free_um - loaded_um) / design.gap_um
        if (closure_rel <= 0.5 * largest_rel).all():
            break
        force_n = 0.5 * force_n
    # Every combination of elements that are off, each by a standard deviation to either side.
    gains = 1.0 + share_rel * np.array(list(product((-1.0, 1.0), repeat=ELEMENTS)))
    estimated_n = np.array(
        [_estimated_n(network, n_rows, closures_rel * gains) for closures_rel in closure_rel]
    )
    sizes_n = np.linalg.norm(estimated_n, axis=2)
    angles_deg = angles_between_deg(estimated_n.reshape(-1, 3), np.repeat(force_n, len(gains), axis=0))
    off_rel = sizes_n / np.linalg.norm(force_n, axis=1)[:, None] - 1.0
    across_rel = math.sqrt(float(np.square(np.radians(angles_deg)).mean()) / 2.0)
    along_rel = math.hypot(float(off_rel.std()), tolerances.stiffness_rel)
    mount_rad = math.radians(tolerances.mount_deg) / math.sqrt(3.0)
    # Rounded, as a network of other rows differs in the last bits.
    gap_rel = tolerances.gap_um / design.gap_um
    return ForceUncertainty(round(along_rel, 4), round(math.hypot(across_rel, mount_rad), 4), gap_rel)


def _estimated_n(network: Network, n_rows: int, closure_rel: Vector) -> Vector:
    """Return the forces of closures at rest [N], shape (n, 3), by a network of so many rows."""
    padded = np.resize(closure_rel, (-(-len(closure_rel) // n_rows) * n_rows, ELEMENTS))
    forces_n = [
        network.estimate(steady_windows(rows)).force_n for rows in padded.reshape(-1, n_rows, ELEMENTS)
    ]
    return np.concatenate(forces_n)[: len(closure_rel)]
