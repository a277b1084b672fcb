"""Networks for feet with different arrays, trained alike and evaluated on unseen loads and gaits."""

from dataclasses import dataclass, replace

import numpy as np

from footsense.estimation.faults.imputation import Imputation
from footsense.foot.directions import angles_between_deg
from footsense.foot.response_table import FootResponse
from footsense.frames import Mask, Vector
from footsense.lab.geometry import LoadRange
from footsense.lab.studies.accuracy.gaits import MIN_DIRECTION_FORCE_N, held_out_walks, leg_loads_function
from footsense.lab.training.gait_readings import (
    GaitReadings,
    ReadingConditions,
    concatenate_gaits,
    random_gaits,
    simulate_gait_readings,
)
from footsense.lab.training.gait_windows import windows_of
from footsense.lab.training.load_cases import random_loads
from footsense.lab.training.snapshot.train import mean_closure_product_matrix
from footsense.lab.training.train_windowed import WindowTrainingSettings, train_windowed
from footsense.lab.training.windowed_network import Weights, predict
from footsense.ports import Window

#: Conversions of a gait, and seeds of the training and of the evaluation.
_CONVERSIONS, _TRAINING_SEED, _TEST_SEED = 1100, 1, 990_001


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingSize:
    """Sizes of a training run and of its evaluation.

    Attributes:
        settings: Training settings.
        n_loads: Static loads of the training.
        n_gaits: Random gaits of the training.
        n_test_gaits: Random gaits of the evaluation.
    """

    settings: WindowTrainingSettings
    n_loads: int
    n_gaits: int
    n_test_gaits: int


#: A tenth of the release's training, for every array alike; and seconds for the quick form.
FULL = TrainingSize(
    settings=WindowTrainingSettings(steps=20_000), n_loads=30_000, n_gaits=800, n_test_gaits=60
)
QUICK = TrainingSize(
    settings=WindowTrainingSettings(channels=4, steps=500, batch=256, rate=1e-2),
    n_loads=500,
    n_gaits=8,
    n_test_gaits=2,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkErrors:
    """Direction errors [deg] of one network, for forces from 0.1 N.

    Attributes:
        n_weights: Number of its weights.
        gaits_mean_deg: Mean on random gaits.
        gaits_p95_deg: 95th percentile on random gaits.
        walk_mean_deg: Mean on the measured walk.
        walk_p95_deg: 95th percentile on the measured walk.
        walk_element_missing_mean_deg: Mean on the measured walk with one element missing, another in every reading.
    """

    n_weights: int
    gaits_mean_deg: float
    gaits_p95_deg: float
    walk_mean_deg: float
    walk_p95_deg: float
    walk_element_missing_mean_deg: float


def train_and_evaluate_network(response: FootResponse, loads: LoadRange, size: TrainingSize) -> NetworkErrors:
    """Return the direction errors of a newly trained network on random gaits and on the measured walk.

    Args:
        response: Response of the foot.
        loads: Loads of the training; those beyond the converter's range are left out.
        size: Sizes of training and evaluation.
    """
    rest = random_loads(response, loads, size.n_loads, _TRAINING_SEED)
    imputation = Imputation(
        mean_closure_product_matrix(rest.with_symmetric_copies().closure_um / response.design.gap_um)
    )
    gaits = random_gaits(response, _TRAINING_SEED, size.n_gaits, _CONVERSIONS, loads.max_n, jobs=2)
    settings = replace(size.settings, min_force_n=loads.min_relative_loss_force_n)
    weights = train_windowed(gaits, rest, response.design, settings, imputation)
    test_gaits = random_gaits(response, _TEST_SEED, size.n_test_gaits, _CONVERSIONS, loads.max_n)
    walk = _readings_under_measured_walk(response)
    gaits_deg = _direction_errors_deg(weights, imputation, test_gaits)
    walk_deg = _direction_errors_deg(weights, imputation, walk)
    missing_deg = _direction_errors_deg(weights, imputation, walk, element_missing=True)
    return NetworkErrors(
        n_weights=weights.n_weights,
        gaits_mean_deg=float(gaits_deg.mean()),
        gaits_p95_deg=float(np.percentile(gaits_deg, 95)),
        walk_mean_deg=float(walk_deg.mean()),
        walk_p95_deg=float(np.percentile(walk_deg, 95)),
        walk_element_missing_mean_deg=float(missing_deg.mean()),
    )


def _readings_under_measured_walk(response: FootResponse) -> GaitReadings:
    """Return simulated readings of a right and a left foot under the ground forces of the measured walk."""
    source, _ = held_out_walks()
    readings = [
        simulate_gait_readings(
            response,
            leg_loads_function(source, leg),
            ReadingConditions(),
            np.random.default_rng((_TEST_SEED, number)),
            2 * _CONVERSIONS,
        )
        for number, leg in enumerate(("rf", "lf"))
    ]
    return concatenate_gaits(readings)


def _direction_errors_deg(
    weights: Weights, imputation: Imputation, gaits: GaitReadings, *, element_missing: bool = False
) -> Vector:
    """Return a network's direction errors on the loaded windows of gaits [deg]."""
    windows = windows_of(gaits)
    loaded = np.linalg.norm(windows.force_n, axis=1) > MIN_DIRECTION_FORCE_N
    closure_rel = windows.closure_rel[loaded]
    missing: Mask = np.zeros((len(closure_rel), gaits.rows**2), bool)
    if element_missing:
        missing[np.arange(len(missing)), np.arange(len(missing)) % gaits.rows**2] = True
        closure_rel = imputation.impute(closure_rel, missing)
    load = predict(weights, Window(closure_rel, windows.age_s[loaded], missing))
    return angles_between_deg(load.force_n, windows.force_n[loaded])
