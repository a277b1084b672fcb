"""Study `experiment`: the paper's experiment on simulated feet with fabrication tolerances.

Source:
    Aoyagi et al., section V C.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from msgspec.structs import asdict

from footsense.cli.lab.pages.experiment_figure import errors_over_n_loads_figure
from footsense.errors import FootsenseError
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.training.paper.per_foot_network import per_foot_force_n
from footsense.lab.training.paper.procedure import EPOCHS
from footsense.sim.fabrication import PAPER_TOLERANCES, FootTolerances
from footsense.validation.processes import run_in_processes
from footsense.validation.test_stand_trial import FootBatch
from footsense.validation.virtual_experiment import (
    CALIBRATION_LOAD_COUNTS,
    N_ALL_LOADS,
    FootResult,
    evaluate_foot,
)

#: Feet of a full run, and of a quick one with one of so many loads.
N_FEET, QUICK_N_FEET, _QUICK_EVERY = 20, 2, 9
#: Epochs of the network without physics in a quick run.
_QUICK_EPOCHS = 500
#: The estimators, in words.
ESTIMATOR_DESCRIPTIONS = {
    "design_only": "network of the design alone",
    **{f"calibrated_{n}": f"calibrated with {n} loads" for n in CALIBRATION_LOAD_COUNTS},
    f"calibrated_{N_ALL_LOADS}": "calibrated with all loads",
    "linear_per_foot": "linear in ΔC, the foot's own loads",
    "network_per_foot": "network on ΔC, the foot's own loads",
}
_FIGURE_FILE = "experiment.png"
_DEFAULT_BATCH = FootBatch()


@dataclass(frozen=True, slots=True)
class MeanStdOverFeet:
    """Mean and standard deviation of a figure over the feet."""

    mean: float
    std: float

    @classmethod
    def of_values(cls, values: Sequence[float]) -> "MeanStdOverFeet":
        """Return mean and standard deviation of the values, rounded to three decimals."""
        return cls(round(float(np.mean(values)), 3), round(float(np.std(values)), 3))

    def __str__(self) -> str:
        return f"{self.mean:.2f} ± {self.std:.2f}"


@dataclass(frozen=True, kw_only=True)
class ExperimentResults:
    """Results of the simulated experiment: force errors of all estimators, load counts and refused calibrations.

    Attributes:
        seed: Of the feet and of the test stand.
        foot_type: Type of the feet.
        tolerances: Fabrication tolerances.
        load_stride: Every n-th load of the session is applied.
        n_feet: Number of feet.
        errors_by_estimator: By estimator: number of feet (`n_feet`) that it could read, and mean errors as in
            `MeanStdOverFeet`.
        n_training_loads: Accepted loads of the training session.
        n_compared_test_loads: Loads of the test session that all estimators can read.
        n_excluded_test_loads: Loads of the test session that some estimator cannot read.
        calibrate_s: Time of a calibration [s].
        refusals_by_foot: Reasons of refused calibrations, by foot and estimator.
    """

    seed: int
    foot_type: str
    tolerances: FootTolerances
    load_stride: int
    n_feet: int
    errors_by_estimator: dict[str, dict[str, int | MeanStdOverFeet]]
    n_training_loads: MeanStdOverFeet
    n_compared_test_loads: MeanStdOverFeet
    n_excluded_test_loads: MeanStdOverFeet
    calibrate_s: MeanStdOverFeet
    refusals_by_foot: dict[str, dict[str, str]]


def _progress_line(foot_result: FootResult) -> str:
    """Return the progress line of one foot: its errors against the reference before and after calibration."""
    design, calibrated = (
        "refused"
        if errors is None
        else f"{errors.direction_vs_reference_deg:.2f} deg, {errors.magnitude_vs_reference_gf:.2f} gf"
        for errors in map(foot_result.errors_by_estimator.get, ("design_only", f"calibrated_{N_ALL_LOADS}"))
    )
    n_test = foot_result.n_compared_test_loads + foot_result.n_excluded_test_loads
    return (
        f"{foot_result.foot}: {foot_result.n_training_loads} loads, design {design}; calibrated {calibrated}, "
        f"{foot_result.n_excluded_test_loads} of {n_test} not read"
    )


def compute(
    context: StudyContext,
    batch: FootBatch = _DEFAULT_BATCH,
    n_feet: int | None = None,
    jobs: int | None = None,
) -> tuple[ExperimentResults, Plots]:
    """Simulate pressing and calibrating feet; return the errors of all estimators with a figure.

    Args:
        context: The models.
        batch: Seed and type of the feet.
        n_feet: How many; without it as many as a full or a quick run has.
        jobs: Feet at a time; without it one for each processor.

    Raises:
        FootsenseError: No foot could be read.
    """
    every, epochs = (_QUICK_EVERY, _QUICK_EPOCHS) if context.quick else (1, EPOCHS)
    n_feet = n_feet or (QUICK_N_FEET if context.quick else N_FEET)
    network = partial(per_foot_force_n, context.response.design, epochs=epochs)
    feet: list[FootResult] = []
    evaluate = partial(evaluate_foot, batch, per_foot_network=network, every_nth_press=every)
    for one in run_in_processes(evaluate, range(n_feet), jobs or os.cpu_count() or 1):
        feet.append(one)
        context.report_progress(_progress_line(one))
    if not feet:
        raise FootsenseError("no foot could be read")
    feet.sort(key=lambda one: one.foot)

    def over_feet(value: Callable[[FootResult], float]) -> MeanStdOverFeet:
        """Return mean and standard deviation of a figure over the feet."""
        return MeanStdOverFeet.of_values([value(one) for one in feet])

    results = ExperimentResults(
        seed=batch.seed,
        foot_type=batch.foot_type,
        tolerances=PAPER_TOLERANCES,
        load_stride=every,
        n_feet=len(feet),
        errors_by_estimator=_estimator_errors(feet),
        n_training_loads=over_feet(lambda one: one.n_training_loads),
        n_compared_test_loads=over_feet(lambda one: one.n_compared_test_loads),
        n_excluded_test_loads=over_feet(lambda one: one.n_excluded_test_loads),
        calibrate_s=over_feet(lambda one: one.calibrate_s),
        refusals_by_foot={one.foot: one.refusal_by_estimator for one in feet if one.refusal_by_estimator},
    )
    return results, {_FIGURE_FILE: errors_over_n_loads_figure(feet)}


def _estimator_errors(feet: list[FootResult]) -> dict[str, dict[str, int | MeanStdOverFeet]]:
    """Return the errors of every estimator by name, averaged over the feet for which errors exist."""
    found: dict[str, dict[str, int | MeanStdOverFeet]] = {}
    for name in ESTIMATOR_DESCRIPTIONS:
        if read := [asdict(one.errors_by_estimator[name]) for one in feet if name in one.errors_by_estimator]:
            means = {
                error: MeanStdOverFeet.of_values([errors[error] for errors in read]) for error in read[0]
            }
            found[name] = {"n_feet": len(read), **means}
    return found


STUDY = Study(
    name="experiment",
    title="The experiment, on simulated feet",
    compute=compute,
    command="experiment",
)
