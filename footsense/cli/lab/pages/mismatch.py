"""Study `mismatch`: force errors of feet whose physics differ from the model that their calibration assumes."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from time import process_time

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from footsense.calibration.calibrate import (
    MAX_MEDIAN_MAHALANOBIS_DISTANCE,
    WARNING_MEDIAN_MAHALANOBIS_DISTANCE,
)
from footsense.calibration.evaluation import DesignModels
from footsense.cli.lab.pages.mismatch_rows import MISMATCH_ROWS
from footsense.errors import FootsenseError
from footsense.foot.directions import random_directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.specimen import ContactLoads
from footsense.lab.foot_file import FOOT_FILE, load_foot
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.geometry import LoadRange
from footsense.lab.monte_carlo.resumable_run import Job, JobRunner, Tolerances, run_resumable
from footsense.lab.monte_carlo.workers import DEFAULT_N_LOCAL_WORKERS, job_runner
from footsense.lab.other_solids import variant_response
from footsense.lab.training.load_cases import leaning_normals
from footsense.sim.fabrication import PAPER_TOLERANCES
from footsense.sim.loads.press_sequence import paper_presses
from footsense.validation.mismatch_trial import TrialPlan, run_mismatch_trial

#: Feet, presses used and rows of a full run and of a quick one.
N_FEET, QUICK_N_FEET, EVERY, QUICK_EVERY = 20, 2, 2, 6
QUICK_ROW_NAMES = ("none", "reference")
SEED = 8
#: Wanted direction and magnitude error after calibration.
TARGET_DEG, TARGET_GF = 2.0, 3.0
FIGURE = "mismatch.png"
#: Where solved tables and finished feet are kept.
DEFAULT_CACHE_FOLDER = Path("build") / "mismatch"
#: Test loads of the leaning sets, and the band of the full range [gf].
_N_LEANING, FULL_RANGE_GF = 180, (20.0, 200.0)
#: Lowest elevation of a leaning load [deg] with a mount turned by several degrees.
_MIN_ELEVATION_DEG = 32.0


@dataclass(frozen=True, kw_only=True)
class MismatchResults:
    """Results of the study `mismatch`: mean and maximum over the feet, by row of mismatch and figure.

    Attributes:
        n_feet: Feet of each row.
        n_presses_per_calibration: Presses of a calibration.
        mean_over_feet: By row and figure: mean over the feet.
        max_over_feet: By row and figure: the largest over the feet.
        mahalanobis_distance_and_error: By row: distance of each foot's loads, and its mean centred direction error
            [deg].
        response_tables_cpu_s: Processor time of the tables that this run solved; those that it found are not in it [s].
    """

    n_feet: int
    n_presses_per_calibration: int
    mean_over_feet: dict[str, dict[str, float]]
    max_over_feet: dict[str, dict[str, float]]
    mahalanobis_distance_and_error: dict[str, list[tuple[float, float]]]
    response_tables_cpu_s: float

    @property
    def total_cpu_s(self) -> float:
        """Total processor time of all feet, earlier runs included [s]."""
        return self.n_feet * sum(row["cpu_s"] for row in self.mean_over_feet.values())


def test_loads(loads: LoadRange) -> dict[str, ContactLoads]:
    """Return the test loads by name: the paper's centred ones, leaning ones of 100 gf, leaning ones of all sizes."""
    centred_n = paper_presses("verification")
    rng = np.random.default_rng(SEED)
    direction = random_directions(rng, 4 * _N_LEANING, _MIN_ELEVATION_DEG)
    normal = leaning_normals(loads, rng, direction)
    reached = normal[:, 2] >= np.sin(np.radians(_MIN_ELEVATION_DEG))
    direction, normal = direction[reached][:_N_LEANING], normal[reached][:_N_LEANING]
    sizes_gf = rng.uniform(*FULL_RANGE_GF, (_N_LEANING, 1))
    return {
        "centred": ContactLoads.centred(centred_n),
        "leaning": ContactLoads(normal, 100.0 * GRAM_FORCE_N * direction),
        "range": ContactLoads(normal, sizes_gf * GRAM_FORCE_N * direction),
    }


test_loads.__test__ = False  # type: ignore[attr-defined]  # no test for pytest


@lru_cache(maxsize=1)
def _load_design_models(folder: Path) -> DesignModels:
    """Return the models of the designed foot from a folder."""
    return DesignModels.load(folder)


def evaluate_job(job: Job, *, models: Path, tables: Path, plan: TrialPlan) -> dict[str, float]:
    """Return the figures of one foot of one row, by name.

    Args:
        job: Foot and row.
        models: Folder of the released models.
        tables: Folder of the solved tables.
        plan: What is done with it.
    """
    design, known, row = load_foot(models / FOOT_FILE), _load_design_models(models), MISMATCH_ROWS[job.case]
    truth = variant_response(row.solid, known.response, design, tables)
    began_s = process_time()
    figures = run_mismatch_trial(known, truth, row.disturbance, plan, job.foot)
    return {**figures, "cpu_s": process_time() - began_s}


def run_study(
    context: StudyContext,
    workers: JobRunner | None = None,
    *,
    rows: Sequence[str] = (),
    n_feet: int | None = None,
    kept: Path = DEFAULT_CACHE_FOLDER,
) -> tuple[MismatchResults, Plots]:
    """Return the results of the given rows, evaluating the feet that are not finished yet, with a figure.

    Args:
        context: The models.
        workers: Run the feet; processes on this machine if None.
        rows: Names of rows; all, or those of a quick run, if empty.
        n_feet: Feet of each row.
        kept: Folder of solved tables and finished feet.

    Raises:
        FootsenseError: There is no such row.
    """
    if unknown := [name for name in rows if name not in MISMATCH_ROWS]:
        raise FootsenseError(f"no row {unknown[0]!r}: there are {', '.join(MISMATCH_ROWS)}")
    names = tuple(rows) or (QUICK_ROW_NAMES if context.quick else tuple(MISMATCH_ROWS))
    n_feet = n_feet or (QUICK_N_FEET if context.quick else N_FEET)
    plan = TrialPlan(
        tolerances=PAPER_TOLERANCES,
        seed=SEED,
        every_nth_press=QUICK_EVERY if context.quick else EVERY,
        test_loads_by_name=test_loads(context.foot_design.loads),
    )
    began_s = process_time()
    for name in names:  # solved once, not by each worker
        variant_response(MISMATCH_ROWS[name].solid, context.response, context.foot_design, kept)
        context.report_progress(f"{name}: table ready")
    tables_s = process_time() - began_s
    about: dict[str, str | int] = {
        "study": "mismatch",
        "seed": SEED,
        "every": plan.every_nth_press,
        "models": hashlib.sha256((context.models / "network.onnx").read_bytes()).hexdigest(),
        "tolerances": str(plan.tolerances),
    }
    work = partial(evaluate_job, models=context.models.resolve(), tables=kept.resolve(), plan=plan)
    run = workers or job_runner(n_workers=1 if context.quick else DEFAULT_N_LOCAL_WORKERS)
    mean_over_feet, max_over_feet, error_over_distance = {}, {}, {}
    for name in names:
        jobs = [Job(Tolerances(), foot, case=name) for foot in range(n_feet)]
        digest = hashlib.sha256(f"{about} {MISMATCH_ROWS[name]}".encode()).hexdigest()[:12]
        file = kept / f"{name}-{digest}.jsonl"
        made = list(run_resumable(about, jobs, work, workers=run, file=file).values())
        columns = {figure: np.array([one[figure] for one in made]) for figure in made[0]}
        mean_over_feet[name] = {
            figure: round(float(np.nanmean(values)), 3) for figure, values in columns.items()
        }
        max_over_feet[name] = {
            figure: round(float(np.nanmax(values)), 3) for figure, values in columns.items()
        }
        error_over_distance[name] = [
            (round(one["distance_all"], 2), round(one["centred_all_deg"], 3)) for one in made
        ]
        context.report_progress(f"{name}: {_progress_line(mean_over_feet[name])}")
    presses = len(paper_presses("training")[:: plan.every_nth_press])
    results = MismatchResults(
        n_feet=n_feet,
        n_presses_per_calibration=presses,
        mean_over_feet=mean_over_feet,
        max_over_feet=max_over_feet,
        mahalanobis_distance_and_error=error_over_distance,
        response_tables_cpu_s=round(tables_s, 1),
    )
    return results, {FIGURE: _figure(results)}


def _figure(results: MismatchResults) -> Figure:
    """Return the figure of errors after calibration by row, and of error over load distance."""
    figure = Figure(figsize=(12.0, max(0.28 * len(results.mean_over_feet) + 1.6, 4.5)), layout="constrained")
    bars, dots = figure.subplots(1, 2, width_ratios=(5, 6))
    places = np.arange(len(results.mean_over_feet))
    for shift, test in ((-0.2, "centred"), (0.2, "leaning")):
        errors_deg = [row[f"{test}_all_deg"] for row in results.mean_over_feet.values()]
        bars.barh(places + shift, errors_deg, 0.4, label=f"{test}, 100 gf")
    bars.axvline(TARGET_DEG, color="k", ls=":", label="wanted at most")
    bars.set(
        yticks=places,
        yticklabels=[MISMATCH_ROWS[name].title for name in results.mean_over_feet],
        xscale="log",
        xlabel="direction error after calibration, mean [deg]",
        title="what differs from the model",
    )
    bars.invert_yaxis()
    bars.legend(fontsize="small")
    _draw_error_over_mahalanobis(dots, results)
    return figure


def _draw_error_over_mahalanobis(dots: Axes, results: MismatchResults) -> None:
    """Draw each foot's error over the distance of its loads, in zones of trust, with outliers named."""
    marks = {True: ("o", "C0", "a calibration can represent it"), False: ("x", "C3", "it cannot")}
    for name, feet in results.mahalanobis_distance_and_error.items():
        marker, color, _ = marks[MISMATCH_ROWS[name].is_representable]
        distance, error_deg = np.array(feet).T
        dots.scatter(distance, error_deg, s=12, marker=marker, color=color, alpha=0.7, linewidths=1.0)
        middle, highest = np.median(feet, axis=0)[0], np.max(feet, axis=0)[1]
        if middle > WARNING_MEDIAN_MAHALANOBIS_DISTANCE:
            place = (middle, highest)
            dots.annotate(name, place, (0, 5), textcoords="offset points", ha="center", fontsize="small")
    for marker, color, label in marks.values():
        dots.scatter([], [], marker=marker, color=color, label=label)
    last = 1.1 * max(
        MAX_MEDIAN_MAHALANOBIS_DISTANCE,
        *(foot[0] for feet in results.mahalanobis_distance_and_error.values() for foot in feet),
    )
    edges = (0.0, WARNING_MEDIAN_MAHALANOBIS_DISTANCE, MAX_MEDIAN_MAHALANOBIS_DISTANCE, last)
    for left, right, color, word in zip(
        edges, edges[1:], ("C2", "C1", "C3"), ("trust", "check", "refused"), strict=False
    ):
        dots.axvspan(left, right, color=color, alpha=0.12, lw=0.0)
        dots.text(
            (left + right) / 2.0, 0.97, word, transform=dots.get_xaxis_transform(), ha="center", va="top"
        )
    dots.set(
        xlim=(0.0, last),
        yscale="log",
        xlabel="median distance of the loads from the fitted foot",
        ylabel="direction error after calibration, centred [deg]",
        title="whether to trust a foot; one point each",
    )
    dots.set_ylim(top=1.8 * dots.get_ylim()[1])
    dots.legend(fontsize="small", loc="lower right")


def _progress_line(row: dict[str, float]) -> str:
    """Return the progress line of one row."""
    return (
        f"design {row['centred_design_deg']:.1f} deg, calibrated {row['centred_all_deg']:.2f} deg "
        f"{row['centred_all_gf']:.2f} gf, leaning {row['leaning_all_deg']:.2f} deg {row['leaning_all_gf']:.2f} gf; "
        f"few {row['centred_few_deg']:.2f} deg; distance {row['distance_all']:.1f}, refused {row['refused_all']:.0%}, "
        f"within 2 sigma {row['leaning_all_within_2']:.0%}"
    )


def compute(context: StudyContext) -> tuple[MismatchResults, Plots]:
    """Return the results of all rows, evaluated by processes on this machine, with a figure."""
    return run_study(context)


STUDY = Study(
    name="mismatch",
    title="Feet that the calibration does not know",
    compute=compute,
    command="mismatch",
)
