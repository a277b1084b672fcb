"""Study `released`: the network's force errors, sigma coverage, and added error with missing elements."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from footsense.estimation.missing_elements import MISSING_SETS, Imputation
from footsense.estimation.network import steady_windows
from footsense.foot.force_errors import ForceErrors, evaluate_force_errors
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate import rms, sigma_coverage_shares
from footsense.lab.evaluation.evaluate_models import (
    HELD_OUT_CASES,
    HELD_OUT_SEED,
    as_markdown,
    evaluate_models,
)
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.monte_carlo.resumable_run import Tolerances
from footsense.lab.plots import subplot_row
from footsense.lab.training.load_cases import measured_closure_rel, random_loads
from footsense.sim.foot.fabrication import draw_deviations

#: Missing elements, as an index into `MISSING_SETS`.
MISSING_SET_INDEX_BY_NAME = {
    "nothing": 0,
    "a corner": 1,
    "an edge": 2,
    "the middle": 5,
    "an outer row": 10,
    "the middle row": 11,
}
#: Feet other than the designed one: rms deviations of each batch.
FOOT_BATCHES = {
    "gaps off by 0.5 um": Tolerances(gap_um=0.5),
    "gaps off by 2 um": Tolerances(gap_um=2.0),
    "strays of 0.01 pF": Tolerances(stray_pf=0.01),
    "strays of 0.1 pF": Tolerances(stray_pf=0.1),
    "stiffness off by 1 %": Tolerances(stiffness_rel=0.01),
    "stiffness off by 5 %": Tolerances(stiffness_rel=0.05),
    "mount off by 1 deg": Tolerances(mount_deg=1.0),
}
#: Feet of each batch, loads on each.
N_FEET, N_LOADS, _FEET_SEED = 20, 500, 7
N_QUICK_FEET = 2
#: Bins of force for the coverage over the loading range [N].
FORCE_BINS_N = (0.0, 0.05, 0.2, 0.5, 1.0, 2.0)


#: Shares of errors within one and two sigma, per axis.
SigmaCoverage = dict[str, list[float]]


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `released`: force errors and sigma coverage, also with missing elements and on other feet.

    Attributes:
        errors_by_estimator_and_cases: The error table, by estimator and cases.
        weights: Weights of the network.
        min_evaluated_force_n: Smallest held-out load that counts in errors [N].
        n_feet: Feet of each batch.
        errors_by_missing_pattern: Errors with missing elements.
        coverage_by_missing_pattern: Coverage with missing elements.
        coverage_by_force_n: Coverage on the designed foot, by ranges of the force [N].
        coverage_by_foot_batch: Coverage on feet that differ from the design, by batch.
    """

    errors_by_estimator_and_cases: dict[str, ForceErrors]
    weights: int
    min_evaluated_force_n: float
    n_feet: int
    errors_by_missing_pattern: dict[str, ForceErrors]
    coverage_by_missing_pattern: dict[str, SigmaCoverage]
    coverage_by_force_n: dict[str, SigmaCoverage]
    coverage_by_foot_batch: dict[str, SigmaCoverage]


def _coverage_on_feet(context: StudyContext, tolerances: Tolerances, n_feet: int) -> SigmaCoverage:
    """Return the sigma coverage over a batch of random feet with the given tolerances."""
    response, n_loads = context.response, 100 if context.quick else N_LOADS
    parts = []
    for number in range(n_feet):
        deviations = draw_deviations(response, tolerances, _FEET_SEED, number)
        cases = random_loads(response, context.foot_design.loads, n_loads, 1000 + number, deviations)
        rng = np.random.default_rng((number, _FEET_SEED))
        closure_rel = measured_closure_rel(response.design, cases.closure_um, rng)
        parts.append((cases.force_n, *context.network.estimate(steady_windows(closure_rel))[:2]))
    truth, force_n, sigma_n = (np.concatenate(part) for part in zip(*parts, strict=True))
    return sigma_coverage_shares(truth, force_n, sigma_n)


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the network's errors and sigma coverage on held-out loads, with missing elements and on other feet."""
    network, loads = context.network, context.foot_design.loads
    cases = random_loads(context.response, loads, 2000 if context.quick else HELD_OUT_CASES, HELD_OUT_SEED)
    rng = np.random.default_rng(HELD_OUT_SEED)
    closure_rel = measured_closure_rel(context.response.design, cases.closure_um, rng)
    context.report_progress("released: held-out loads drawn")
    size = np.linalg.norm(cases.force_n, axis=1)
    counted = size >= loads.min_evaluated_force_n
    imputation = Imputation(np.array(network.card["moments"]))
    missing, missing_coverage = {}, {}
    for name, index in MISSING_SET_INDEX_BY_NAME.items():
        mask = np.tile(MISSING_SETS[index], (len(closure_rel), 1))
        force_n, sigma_n = network.estimate(steady_windows(imputation.impute(closure_rel, mask), mask))[:2]
        missing[name] = evaluate_force_errors(cases.force_n[counted], force_n[counted])
        missing_coverage[name] = sigma_coverage_shares(cases.force_n, force_n, sigma_n)
    force_n, sigma_n = network.estimate(steady_windows(closure_rel))[:2]
    by_force = {}
    for low, high in pairwise(FORCE_BINS_N):
        inside = (size >= low) & (size < high)
        by_force[f"{low:g} to {high:g}"] = sigma_coverage_shares(
            cases.force_n[inside], force_n[inside], sigma_n[inside]
        )
    n_feet = N_QUICK_FEET if context.quick else N_FEET
    results = Results(
        errors_by_estimator_and_cases=evaluate_models(context.models),
        weights=network.card["training"]["weights"],
        min_evaluated_force_n=loads.min_evaluated_force_n,
        n_feet=n_feet,
        errors_by_missing_pattern=missing,
        coverage_by_missing_pattern=missing_coverage,
        coverage_by_force_n=by_force,
        coverage_by_foot_batch={
            name: _coverage_on_feet(context, deviations, n_feet) for name, deviations in FOOT_BATCHES.items()
        },
    )
    return results, {"released-sigma.png": _error_over_sigma_figure(cases.force_n, force_n, sigma_n)}


def _error_over_sigma_figure(truth_n: Vector, force_n: Vector, sigma_n: Vector) -> Figure:
    """Return the figure of measured error over reported sigma, per axis, in equally filled bins."""
    figure, (axes,) = subplot_row(1, 8.0, 3.6)
    for axis, name in enumerate("xyz"):
        order = np.array_split(np.argsort(sigma_n[:, axis]), 20)
        stated = [1e3 * rms(sigma_n[part, axis]) for part in order]
        error = [1e3 * np.percentile(np.abs((truth_n - force_n)[part, axis]), 68.3) for part in order]
        axes.loglog(stated, error, "o-", label=f"f{name}")
    low, high = axes.get_xlim()
    axes.loglog([low, high], [low, high], "k:", label="as stated")
    axes.set(xlabel="stated sigma [mN]", ylabel="measured error, 68.3 % of cases below [mN]")
    axes.legend()
    axes.grid(visible=True, which="both", alpha=0.3)
    return figure


STUDY = Study(
    name="released",
    title="The released network",
    compute=compute,
    template_names={"as_markdown": as_markdown},
)
