"""Feet as they are made, loaded on a bench that is not exact either, and what each read-out makes of them.

Every foot is reproducible by itself, from its number, the campaign's seed and the tolerances. Two kinds of read-outs
are judged: what was learnt on the design, and what is learnt anew from the foot's own 362 measured cases.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from footsense.foot.capacitor import CapacitorDesign
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.lab.evaluation.evaluate import Readout, errors
from footsense.lab.evaluation.evaluate_models import open_models
from footsense.lab.monte_carlo.resumable_run import Figures, Job, Tolerances
from footsense.lab.training.export import OnnxNetwork
from footsense.lab.training.load_cases import Cases, as_designed_um, paper_training, paper_verification
from footsense.lab.training.mlp import start_layers
from footsense.lab.training.paper_procedure import HIDDEN, PaperTraining
from footsense.sim.foot.fabrication import fabricate

Vector = NDArray[np.float64]

#: Resolution of the reference sensor's x, y, z (Table II) [N].
REFERENCE_N = np.array([4.0, 4.0, 12.0]) * GRAM_FORCE_N


def _direction(force_n: Vector) -> Vector:
    """Return unit vectors, shape (n, 3), of forces."""
    unit: Vector = force_n / np.linalg.norm(force_n, axis=1, keepdims=True)
    return unit


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What a bench measures of one foot under loads that were meant to be the paper's.

    Attributes:
        force_n: By the reference sensor [N], shape (n, 3).
        true_n: What the force was [N], shape (n, 3).
        change_pf: Of the capacitances [pF], shape (n, 9).
        closure_um: What the daemon finds by the designed dimensions [um], shape (n, 9).
    """

    force_n: Vector
    true_n: Vector
    change_pf: Vector
    closure_um: Vector


def measure(
    foot: Foot, mount: Vector, true_n: Vector, tolerances: Tolerances, rng: np.random.Generator
) -> Measured:
    """Load a foot on the bench.

    Args:
        foot: The specimen.
        mount: How it sits on its leg, as in its deviations.
        true_n: Forces [N], shape (n, 3).
        tolerances: Of the bench.
        rng: Of its noise.
    """
    response, direction = foot.response, _direction(true_n)
    noise = rng.normal(size=(4, len(true_n), 9))
    # Two of the three axes turn a direction, so that the angle between it and the normal has the stated rms.
    lean = np.radians(tolerances.stick_deg) * np.sqrt(0.5)
    normal = direction + lean * np.cross(direction, np.cross(direction, noise[0, :, :3]))
    normal = _direction(normal)
    unknown = normal @ mount[2] < np.sin(np.radians(response.min_elevation_deg))
    normal[unknown] = direction[unknown]
    unloaded_pf = foot.unloaded_pf
    change_pf = (foot.capacitance_pf(normal, true_n) - unloaded_pf) * (1.0 + tolerances.repeat_rel * noise[1])
    change_pf += tolerances.reading_pf * noise[2]
    return Measured(
        force_n=true_n + tolerances.reference_rel * REFERENCE_N * noise[3, :, :3],
        true_n=true_n,
        change_pf=change_pf,
        closure_um=response.design.closure_um(unloaded_pf + change_pf, unloaded_pf),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Workshop:
    """What every foot is judged with, opened once in each process.

    Attributes:
        response: The design.
        network: Trained on it.
        plain: The paper's own kind of network, taught its 362 cases on the design.
        change_matrix: Linear read-out of capacitance changes of the design [N/pF], shape (9, 3).
        training_n: Forces of the 362 cases [N].
        verification_n: Forces of the 180 cases [N].
    """

    response: FootResponse
    network: OnnxNetwork
    plain: Readout
    change_matrix: Vector
    training_n: Vector
    verification_n: Vector


@lru_cache(maxsize=1)
def _workshop(models: Path, seed: int, epochs: int) -> _Workshop:
    """Open the released models, and teach what is learnt on the design."""
    response, network = open_models(models)
    training = paper_training(response)
    design = response.design
    return _Workshop(
        response=response,
        network=network,
        plain=_taught(design, training, np.random.default_rng(seed), epochs),
        change_matrix=_linear(
            design.capacitance_pf(training.closure_um) - design.unloaded_pf, training.force_n
        ),
        training_n=training.force_n,
        verification_n=paper_verification(response).force_n,
    )


def _taught(design: CapacitorDesign, cases: Cases, rng: np.random.Generator, epochs: int) -> Readout:
    """Return the paper's kind of network, fed with capacitance changes, after it learnt cases."""
    return PaperTraining(design, cases).train([start_layers(rng, (9, *HIDDEN, 3))], epochs)[0]


def _linear(features: Vector, force_n: Vector) -> Vector:
    """Return the least-squares read-out without offset, shape (9, 3)."""
    return np.asarray(np.linalg.lstsq(features, force_n, rcond=None)[0], dtype=np.float64)


def judge(job: Job, *, models: Path, seed: int, epochs: int) -> Figures:
    """Return what the read-outs make of one foot: mean errors over the 180 cases, and how often sigma holds.

    Args:
        job: The foot.
        models: Folder of the released models.
        seed: Of the campaign.
        epochs: That plain networks learn.

    Returns:
        `<read-out>_deg` and `<read-out>_gf` for `network`, `plain` and `change` (learnt on the design), `own_closure`
        and `own_change` (linear, learnt on the foot's own cases), `own_network` if taught, and `reference`: of
        the reference sensor itself; shares `within_1` and `within_2` of the components that the
        network has within 1 and 2 sigma.
    """
    shop = _workshop(models, seed, epochs)
    design = shop.response.design
    own = fabricate(shop.response, job.tolerances, seed, job.foot)
    foot = Foot(shop.response, own)
    rng = np.random.default_rng((seed, job.foot, 1))
    taught = measure(foot, own.mount, shop.training_n, job.tolerances, rng)
    asked = measure(foot, own.mount, shop.verification_n, job.tolerances, rng)
    closure_rel = asked.closure_um / design.gap_um
    shipped_n = shop.network.force_n(closure_rel)
    changed_um = as_designed_um(design, asked.change_pf)
    estimates = {
        "network": shipped_n,
        "plain": shop.plain(changed_um),
        "change": asked.change_pf @ shop.change_matrix,
        "own_closure": asked.closure_um @ _linear(taught.closure_um, taught.force_n),
        "own_change": asked.change_pf @ _linear(taught.change_pf, taught.force_n),
        "reference": asked.true_n,
    }
    if job.taught:
        cases = Cases(taught.force_n, as_designed_um(design, taught.change_pf))
        estimates["own_network"] = _taught(design, cases, np.random.default_rng((seed, job.foot, 2)), epochs)(
            changed_um
        )
    figures: Figures = {}
    for name, estimate in estimates.items():
        row = errors(asked.force_n, estimate)
        figures |= {f"{name}_deg": row.direction_deg, f"{name}_gf": row.magnitude_gf}
    off_rel = np.abs(shipped_n - asked.true_n) / shop.network.sigma_n(closure_rel)
    return figures | {f"within_{k}": float((off_rel <= k).mean()) for k in (1, 2)}
