"""Study `tolerance`: fabrication tolerances that raise the paper's simulated error to its measured error.

The paper measured 15.9 deg and 18.7 gf where it had simulated 2.4 deg and 5.3 gf, and left open why. Here hundreds of
feet are drawn, and estimated by networks and linear fits trained on the design and by those trained on their own cases.

Source:
    Aoyagi et al., section V.
"""

from collections.abc import Iterable
from pathlib import Path

from matplotlib.figure import Figure

from footsense.lab.evaluation import evaluate
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.monte_carlo import sweeps
from footsense.lab.monte_carlo.resumable_run import JobRunner, Tolerances
from footsense.lab.monte_carlo.sweeps import Plan, Sweep, SweepResults, sweep_results
from footsense.lab.monte_carlo.workers import DEFAULT_N_LOCAL_WORKERS, job_runner
from footsense.lab.plots import plot_band

#: Estimators by the names of `specimens.estimator_errors`: trained on the design, and trained on the foot.
DESIGN_TRAINED_ESTIMATORS = {
    "network": "released network",
    "plain": "network on ΔC",
    "change": "linear on ΔC",
}
FOOT_TRAINED_ESTIMATORS = {
    "own_network": "network on ΔC",
    "own_change": "linear on ΔC",
    "own_closure": "linear on closures",
}
_COLOURS = {"released network": "C0", "linear on ΔC": "C1", "linear on closures": "C2", "network on ΔC": "C3"}


def distinct_levels(plan: Plan, selected_sweeps: tuple[Sweep, ...]) -> Iterable[tuple[Sweep, float]]:
    """Return the distinct (sweep, level) pairs of several sweeps, shared tolerances once."""
    levels: dict[Tolerances, tuple[Sweep, float]] = {}
    for sweep in selected_sweeps:
        for level in plan.evaluated_levels(sweep):
            levels.setdefault(sweep.tolerances_at(level), (sweep, level))
    return levels.values()


def _figure(results: SweepResults, selected_sweeps: tuple[Sweep, ...], estimators: dict[str, str]) -> Figure:
    """Return the figure of mean direction error over the level of each imperfection, with standard deviations."""
    figure = Figure(figsize=(9.0, 5.8), layout="constrained")
    subplot_row = figure.subplots(2, 3, sharey=True).ravel()
    for axes, sweep in zip(subplot_row, selected_sweeps, strict=False):
        levels = results.plan.evaluated_levels(sweep)
        for name, label in estimators.items():
            statistics = [results.statistics_over_feet(sweep, level, f"{name}_deg") for level in levels]
            plot_band(axes, levels, statistics, color=_COLOURS[label], label=label)
        axes.axhline(evaluate.MEASURED_DIRECTION_DEG, color="k", ls=":", label="the paper, measured")
        axes.set(xlabel=f"{sweep.varied_quantity}, rms", ylim=(0.0, 45.0))
        axes.grid(alpha=0.3)
    for axes in subplot_row[::3]:
        axes.set_ylabel("mean direction error [deg]")
    if len(selected_sweeps) < len(subplot_row):
        subplot_row[-1].axis("off")
        subplot_row[-1].legend(*subplot_row[0].get_legend_handles_labels(), loc="center")
    else:
        subplot_row[2].legend(fontsize=8)
    return figure


def run_study(
    context: StudyContext, workers: JobRunner, file: Path | None = None
) -> tuple[SweepResults, Plots]:
    """Return the sweep results of the full or quick plan, evaluated by the given workers, with a figure.

    Args:
        context: The models.
        workers: Run the jobs.
        file: As for `sweep_results`.
    """
    plan = sweeps.QUICK_PLAN if context.quick else sweeps.FULL_PLAN
    results = sweep_results(context.models, context.response.design.gap_um, plan, workers, file)
    context.report_progress(
        f"tolerance: {plan.n_feet_per_level} feet at each level of fabrication, "
        f"{plan.n_test_stand_feet_per_level} at each of the test stand"
    )
    figures = {
        "tolerance-feet.png": _figure(results, sweeps.FOOT_SWEEPS, DESIGN_TRAINED_ESTIMATORS),
        "tolerance-test-stand.png": _figure(results, sweeps.TEST_STAND_SWEEPS, FOOT_TRAINED_ESTIMATORS),
    }
    return results, figures


def compute(context: StudyContext) -> tuple[SweepResults, Plots]:
    """Return the sweep results, evaluated by processes on this machine, with a figure."""
    return run_study(context, job_runner(n_workers=1 if context.quick else DEFAULT_N_LOCAL_WORKERS))


STUDY = Study(name="tolerance", title="What fabrication and calibration cost", compute=compute)
