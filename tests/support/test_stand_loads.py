"""Calibration loads of a made foot as a test stand would measure them, without electronics."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.loads import LoadSet
from footsense.daemon.foot_types import released_path
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Deviations, Specimen
from footsense.sim.fabrication import FootTolerances, draw_deviations

Vector = NDArray[np.float64]

MADE = FootTolerances(gap_um=2.5, film_um=1.0, stray_pf=0.35, stiffness_rel=0.2, mount_deg=3.0)


@lru_cache(maxsize=1)
def design() -> DesignModels:
    """Return the released foot type."""
    return DesignModels.load(released_path("network.onnx").parent)


def made(number: int) -> Deviations:
    """Return a foot as made."""
    return draw_deviations(design().response, MADE, 7, number)


def load_set(
    own: Deviations,
    force_n: Vector,
    rng: np.random.Generator | None = None,
    lean_deg: float = 0.7,
    rubber_rel: float = 0.01,
    response: FootResponse | None = None,
) -> LoadSet:
    """Return loads of a foot; exact without a random generator, else with a leaning stick and noise.

    Args:
        own: The foot.
        force_n: Forces [N], shape (n, 3).
        rng: Source of the test stand's errors; None for exact loads.
        lean_deg: Root mean square angle between normal and force [deg].
        rubber_rel: Root mean square share of each force that the rubber's memory adds [1].
        response: Response of its type; None for the released one.
    """
    foot = Specimen(response or design().response, own)
    normal = force_n / np.linalg.norm(force_n, axis=1, keepdims=True)
    noise = np.zeros((3, *force_n.shape)) if rng is None else rng.normal(size=(3, *force_n.shape))
    leaning = normal + np.cross(np.radians(lean_deg) * np.sqrt(0.5) * noise[0], normal)
    leaning /= np.linalg.norm(leaning, axis=1, keepdims=True)
    felt_n = force_n * (1.0 + rubber_rel * noise[1, :, :1])
    return LoadSet(
        force_n=force_n + 0.003 * noise[2],
        sigma_n=np.full(force_n.shape, 0.003),
        capacitance_pf=foot.capacitance_pf(leaning, felt_n),
        baseline_pf=np.tile(foot.unloaded_pf, (len(force_n), 1)),
    )
