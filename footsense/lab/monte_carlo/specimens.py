"""Fabricated feet measured on an inexact test stand, and the errors of each force estimator on them.

Every foot is reproducible by itself, from its number, the run's seed and the tolerances. Two kinds of estimators
are compared: those trained on the design, and those trained on the foot's own 362 measured cases.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from footsense.estimation.network import steady_windows
from footsense.foot.capacitor import Capacitor
from footsense.foot.directions import normalized
from footsense.foot.force_errors import GRAM_FORCE_N, evaluate_force_errors
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate import (
    ForceEstimator,
    capacitance_based_force_estimator,
    elastance_based_force_estimator,
)
from footsense.lab.evaluation.evaluate_models import open_models
from footsense.lab.monte_carlo.resumable_run import Job, JobMetrics, Tolerances
from footsense.lab.training.export import OnnxNetwork
from footsense.lab.training.load_cases import (
    Cases,
    closure_of_designed_foot_um,
    paper_training,
    paper_verification,
)
from footsense.lab.training.paper.mlp import random_layers
from footsense.lab.training.paper.procedure import HIDDEN_NEURONS, PaperTraining
from footsense.sim.fabrication import draw_deviations

#: Resolution of the reference sensor's x, y, z (Table II) [N].
REFERENCE_SENSOR_RESOLUTION_N = np.array([4.0, 4.0, 12.0]) * GRAM_FORCE_N


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredLoads:
    """Measurements of one foot on the test stand, under loads close to the paper's.

    Attributes:
        reference_force_n: Forces of the reference sensor [N], shape (n, 3).
        change_pf: Changes of the capacitances [pF], shape (n, 9).
        closure_um: Closures by the designed dimensions [um], shape (n, 9).
    """

    reference_force_n: Vector
    change_pf: Vector
    closure_um: Vector


def measure_foot(
    foot: Foot, mount: Vector, true_n: Vector, tolerances: Tolerances, rng: np.random.Generator
) -> MeasuredLoads:
    """Return simulated test-stand measurements of a foot.

    Args:
        foot: The specimen.
        mount: Rotation on its leg, as in its deviations.
        true_n: Forces [N], shape (n, 3).
        tolerances: Rms errors of the test stand.
        rng: Random generator of the noise.
    """
    response, direction = foot.response, normalized(true_n)
    noise = rng.normal(size=(4, len(true_n), 9))
    # Two of the three axes turn a direction, so that the angle between it and the normal has the stated rms.
    lean = np.radians(tolerances.press_lean_deg) * np.sqrt(0.5)
    normal = direction + lean * np.cross(direction, np.cross(direction, noise[0, :, :3]))
    normal = normalized(normal)
    unknown = normal @ mount[2] < np.sin(np.radians(response.min_elevation_deg))
    normal[unknown] = direction[unknown]
    unloaded_pf = foot.unloaded_pf
    change_pf = (foot.capacitance_pf(normal, true_n) - unloaded_pf) * (
        1.0 + tolerances.repeatability_rel * noise[1]
    )
    change_pf += tolerances.reading_noise_pf * noise[2]
    return MeasuredLoads(
        reference_force_n=true_n
        + tolerances.reference_error_resolutions * REFERENCE_SENSOR_RESOLUTION_N * noise[3, :, :3],
        change_pf=change_pf,
        closure_um=response.design.closure_um(unloaded_pf + change_pf, unloaded_pf),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _TrainedEstimators:
    """Released models and force estimators fitted to the design, loaded once in each process.

    Attributes:
        response: The design.
        network: The released network.
        estimators: By name: `plain`, the paper's kind of network, and `change`, linear in capacitance changes.
        training_force_n: Forces of the 362 cases [N].
        verification_force_n: Forces of the 180 cases [N].
    """

    response: FootResponse
    network: OnnxNetwork
    estimators: dict[str, ForceEstimator]
    training_force_n: Vector
    verification_force_n: Vector


@lru_cache(maxsize=1)
def _load_and_train_estimators(models: Path, seed: int, epochs: int) -> _TrainedEstimators:
    """Load the released models, and train the other force estimators."""
    response, network = open_models(models)
    training = paper_training(response)
    return _TrainedEstimators(
        response=response,
        network=network,
        estimators={
            "plain": _train_paper_network(response.design, training, np.random.default_rng(seed), epochs),
            "change": capacitance_based_force_estimator(response.design, training),
        },
        training_force_n=training.force_n,
        verification_force_n=paper_verification(response).force_n,
    )


def _train_paper_network(
    design: Capacitor, cases: Cases, rng: np.random.Generator, epochs: int
) -> ForceEstimator:
    """Return the paper's network, trained on capacitance changes, as a force estimator."""
    return PaperTraining(design, cases).train([random_layers(rng, (9, *HIDDEN_NEURONS, 3))], epochs)[0]


def estimator_errors(job: Job, *, models: Path, seed: int, epochs: int) -> JobMetrics:
    """Return the mean errors of all force estimators on one foot over the 180 cases, and the coverage of sigma.

    Args:
        job: The foot.
        models: Folder of the released models.
        seed: Seed of the run.
        epochs: Training epochs of plain networks.

    Returns:
        `<estimator>_deg` and `<estimator>_gf` for `network`, `plain` and `change` (trained on the design),
        `own_closure` and `own_change` (linear, fitted to the foot's own cases), `own_network` if the job asks
        for it, and `reference`: of the reference sensor itself; shares `within_1` and `within_2` of the force
        components within 1 and 2 sigma of the network.
    """
    on_design = _load_and_train_estimators(models, seed, epochs)
    design, network = on_design.response.design, on_design.network
    own = draw_deviations(on_design.response, job.tolerances, seed, job.foot)
    foot = Foot(on_design.response, own)
    rng = np.random.default_rng((seed, job.foot, 1))
    training = measure_foot(foot, own.mount, on_design.training_force_n, job.tolerances, rng)
    test = measure_foot(foot, own.mount, on_design.verification_force_n, job.tolerances, rng)
    closure_rel = test.closure_um / design.gap_um
    changed_um = closure_of_designed_foot_um(design, test.change_pf)
    own_changes = Cases(training.reference_force_n, closure_of_designed_foot_um(design, training.change_pf))
    network_n = network.force_n(closure_rel)
    estimates = {
        "network": network_n,
        **{name: read(changed_um) for name, read in on_design.estimators.items()},
        "own_closure": elastance_based_force_estimator(
            Cases(training.reference_force_n, training.closure_um)
        )(test.closure_um),
        "own_change": capacitance_based_force_estimator(design, own_changes)(changed_um),
        "reference": on_design.verification_force_n,
    }
    if job.with_network:
        rng = np.random.default_rng((seed, job.foot, 2))
        estimates["own_network"] = _train_paper_network(design, own_changes, rng, epochs)(changed_um)
    figures: JobMetrics = {}
    for name, estimate in estimates.items():
        row = evaluate_force_errors(test.reference_force_n, estimate)
        figures |= {f"{name}_deg": row.direction_deg, f"{name}_gf": row.magnitude_gf}
    off_rel = (
        np.abs(network_n - on_design.verification_force_n)
        / network.estimate(steady_windows(closure_rel)).sigma_n
    )
    return figures | {f"within_{k}": float((off_rel <= k).mean()) for k in (1, 2)}
