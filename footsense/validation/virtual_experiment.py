"""The paper's experiment in simulation: many feet pressed, calibrated and evaluated.

Every estimator is evaluated on the same loads, of a session that none was trained on, against the reference of the test
stand, as in the paper, and against the simulator's true force. Loads for which some estimator has no force are left out
for all, and counted.
"""

from collections.abc import Callable

import msgspec
import numpy as np

from footsense.calibration.calibrate import calibrate
from footsense.calibration.evaluation import DesignModels
from footsense.calibration.loads import LoadSet
from footsense.calibration.rubber_memory import correct_baselines_for_creep
from footsense.clock import stopwatch_ns
from footsense.daemon.foot_types import foot_type_folder
from footsense.errors import CalibrationError
from footsense.foot.force_errors import evaluate_force_errors
from footsense.frames import Vector
from footsense.validation.test_stand_trial import FootBatch, foot_name, press_foot

#: Numbers of loads that a calibration uses; the last is all there are.
CALIBRATION_LOAD_COUNTS = (5, 10, 20, 50, 100)
N_ALL_LOADS = 362

#: Trains on changes of capacitance [pF], shape (n, 9), and forces [N], shape (n, 3); returns those of other changes.
PerFootNetwork = Callable[[Vector, Vector, Vector], Vector]


class MeanForceErrors(msgspec.Struct, frozen=True):
    """Mean direction and magnitude errors of one estimator on one foot.

    Attributes:
        direction_vs_reference_deg: Mean angle to the reference force [deg].
        magnitude_vs_reference_gf: Mean magnitude error against it [gf].
        direction_vs_truth_deg: Mean angle to the true force [deg].
        magnitude_vs_truth_gf: Mean magnitude error against it [gf].
    """

    direction_vs_reference_deg: float
    magnitude_vs_reference_gf: float
    direction_vs_truth_deg: float
    magnitude_vs_truth_gf: float


class FootResult(msgspec.Struct, frozen=True, kw_only=True):
    """Calibration result and force errors of one simulated foot, by estimator.

    Attributes:
        foot: Its identity.
        n_training_loads: Accepted loads of the training session.
        n_compared_test_loads: Loads of the test session on which all estimators are compared.
        n_excluded_test_loads: Loads of the test session for which some estimator has no force.
        errors_by_estimator: Errors by estimator: `design_only`, `calibrated_<n>`, `linear_per_foot`,
            `network_per_foot`.
        refusal_by_estimator: Why a calibration was refused, by estimator.
        calibrate_s: Time from the recording to the parameters, with all loads [s].
    """

    foot: str
    n_training_loads: int
    n_compared_test_loads: int
    n_excluded_test_loads: int
    errors_by_estimator: dict[str, MeanForceErrors]
    refusal_by_estimator: dict[str, str]
    calibrate_s: float


def evaluate_foot(
    batch: FootBatch,
    number: int,
    *,
    per_foot_network: PerFootNetwork | None,
    every_nth_press: int,
) -> FootResult:
    """Simulate the sessions of one foot, calibrate it, and return its force errors by estimator.

    Args:
        batch: Batch of the foot.
        number: Number of the foot in it.
        per_foot_network: Trains a network on one foot without a physical model; None to leave it out.
        every_nth_press: Use one of so many presses.
    """
    models = DesignModels.load(foot_type_folder(batch.foot_type))
    pressed = press_foot(batch, number, every_nth_press=every_nth_press)
    training, test = (
        correct_baselines_for_creep(models.response, one) for one in (pressed.training, pressed.test)
    )
    refusal_by_estimator: dict[str, str] = {}
    calibrated = {}
    order = training.space_filling_order()
    for wanted in (N_ALL_LOADS, *(n for n in CALIBRATION_LOAD_COUNTS if n < len(training))):
        loads = training if wanted == N_ALL_LOADS else training.subset(order[:wanted])
        began_ns = stopwatch_ns()
        try:
            calibrated[f"calibrated_{wanted}"] = calibrate(models, loads).parameters
        except CalibrationError as error:
            refusal_by_estimator[f"calibrated_{wanted}"] = str(error)
        if wanted == N_ALL_LOADS:
            fit_s = (stopwatch_ns() - began_ns) * 1e-9
    estimates_n = {
        name: models.estimate(test, foot).force_n
        for name, foot in ({"design_only": None} | calibrated).items()
    }
    usable = np.logical_and.reduce([np.isfinite(force_n).all(axis=1) for force_n in estimates_n.values()])
    estimates_n |= _per_foot_estimates_n(training, test, per_foot_network)
    return FootResult(
        foot=foot_name(number),
        n_training_loads=len(training),
        n_compared_test_loads=int(usable.sum()),
        n_excluded_test_loads=int((~usable).sum()) + pressed.n_rejected_test_presses,
        errors_by_estimator={
            name: _foot_errors(test.force_n[usable], pressed.test_true_force_n[usable], force_n[usable])
            for name, force_n in estimates_n.items()
        },
        refusal_by_estimator=refusal_by_estimator,
        calibrate_s=pressed.training_read_duration_s + fit_s,
    )


def _per_foot_estimates_n(
    training: LoadSet, test: LoadSet, per_foot_network: PerFootNetwork | None
) -> dict[str, Vector]:
    """Return the test forces [N], shape (n, 3), of each estimator trained on this foot alone, by name."""
    change_pf, test_pf = (loads.capacitance_pf - loads.baseline_pf for loads in (training, test))
    found = {"linear_per_foot": test_pf @ np.linalg.lstsq(change_pf, training.force_n, rcond=None)[0]}
    if per_foot_network is not None:
        found["network_per_foot"] = per_foot_network(change_pf, training.force_n, test_pf)
    return found


def _foot_errors(reference_n: Vector, true_force_n: Vector, force_n: Vector) -> MeanForceErrors:
    """Return the mean errors of estimated forces against the reference and the true forces."""
    by_reference, by_truth = (
        evaluate_force_errors(reference_n, force_n),
        evaluate_force_errors(true_force_n, force_n),
    )
    return MeanForceErrors(
        by_reference.direction_deg, by_reference.magnitude_gf, by_truth.direction_deg, by_truth.magnitude_gf
    )
