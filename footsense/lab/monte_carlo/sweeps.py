"""Sweeps of fabrication and calibration tolerances, with statistics over the feet at each level."""

import hashlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from footsense.lab.evaluation.evaluate_models import NETWORK_FILE, RESPONSE_FILE
from footsense.lab.monte_carlo.resumable_run import Job, JobRunner, Tolerances, run_resumable
from footsense.lab.monte_carlo.specimens import estimator_errors
from footsense.lab.monte_carlo.statistics import MeanStd
from footsense.lab.training.paper.procedure import EPOCHS, QUICK_EPOCHS

#: Of all random numbers of the study.
SEED = 20090304

NO_DEVIATIONS = Tolerances()
#: A plausible foot of soft lithography; those of the paper's are not published.
TYPICAL_TOLERANCES = Tolerances(gap_um=1.0, film_um=1.0, stray_pf=0.05, stiffness_rel=0.1, mount_deg=2.0)
#: A careful test stand: the paper's meter and reference sensor, and a stick set by hand.
CAREFUL_TEST_STAND = Tolerances(
    reading_noise_pf=0.001, repeatability_rel=0.02, reference_error_resolutions=0.5, press_lean_deg=1.0
)
#: Feet and test stand on which the paper's own procedure errs as in the paper's experiment (study `error-causes`): the
#: feet of the study `experiment`; a stick set by hand; a reference and a meter that are read once, one after the other.
PAPER_LIKE_TOLERANCES = Tolerances(
    gap_um=2.0,
    film_um=1.0,
    stray_pf=0.34,
    stiffness_rel=0.2,
    mount_deg=3.0,
    reading_noise_pf=0.001,
    repeatability_rel=0.02,
    reference_error_resolutions=1.1,
    press_lean_deg=2.15,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """A tolerance that is varied over several levels, on top of base tolerances.

    Attributes:
        varied_quantity: Varied quantity, with the unit of the levels.
        unit_level_tolerances: Tolerances at level 1.
        levels: Levels, rising, without 0.
        base_tolerances: Constant tolerances, added at every level.
    """

    varied_quantity: str
    unit_level_tolerances: Tolerances
    levels: tuple[float, ...]
    base_tolerances: Tolerances = NO_DEVIATIONS

    def tolerances_at(self, level: float) -> Tolerances:
        """Return the tolerances at a level of the sweep."""
        return self.base_tolerances.plus_scaled(self.unit_level_tolerances, level)


FOOT_SWEEPS = (
    Sweep(
        varied_quantity="gap [um]",
        unit_level_tolerances=Tolerances(gap_um=1.0),
        levels=(0.5, 1.0, 2.0, 3.0, 5.0, 8.0),
    ),
    Sweep(
        varied_quantity="unknown stray [pF]",
        unit_level_tolerances=Tolerances(stray_pf=1.0),
        levels=(0.05, 0.1, 0.2, 0.5, 1.0),
    ),
    Sweep(
        varied_quantity="stiffness [%]",
        unit_level_tolerances=Tolerances(stiffness_rel=0.01),
        levels=(5.0, 10.0, 20.0, 40.0),
    ),
    Sweep(
        varied_quantity="mount [deg]",
        unit_level_tolerances=Tolerances(mount_deg=1.0),
        levels=(1.0, 2.0, 5.0, 10.0),
    ),
    Sweep(
        varied_quantity="film [um]",
        unit_level_tolerances=Tolerances(film_um=1.0),
        levels=(0.5, 1.0, 2.0, 4.0),
    ),
    Sweep(
        varied_quantity="all, times typical",
        unit_level_tolerances=TYPICAL_TOLERANCES,
        levels=(0.5, 1.0, 2.0, 3.0, 5.0),
    ),
)
TEST_STAND_SWEEPS = (
    Sweep(
        varied_quantity="reading [fF]",
        unit_level_tolerances=Tolerances(reading_noise_pf=0.001),
        levels=(1.0, 5.0, 20.0),
    ),
    Sweep(
        varied_quantity="repeatability of ΔC [%]",
        unit_level_tolerances=Tolerances(repeatability_rel=0.01),
        levels=(2.0, 5.0, 20.0),
    ),
    Sweep(
        varied_quantity="reference [resolutions]",
        unit_level_tolerances=Tolerances(reference_error_resolutions=1.0),
        levels=(0.5, 1.0, 3.0),
    ),
    Sweep(
        varied_quantity="stick [deg]",
        unit_level_tolerances=Tolerances(press_lean_deg=1.0),
        levels=(1.0, 2.0, 5.0, 8.0),
    ),
    Sweep(
        varied_quantity="all of it, times careful",
        unit_level_tolerances=CAREFUL_TEST_STAND,
        levels=(1.0, 2.0, 4.0),
        base_tolerances=TYPICAL_TOLERANCES,
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Sizes of a Monte Carlo run: feet per level, training epochs, thinning of levels.

    Attributes:
        n_feet_per_level: Feet at every level.
        n_test_stand_feet_per_level: Feet at every level of the test stand, each with a network of its own; at least 2.
        epochs: Training epochs of such a network.
        level_stride: Every `level_stride`-th level is done.
    """

    n_feet_per_level: int
    n_test_stand_feet_per_level: int
    epochs: int
    level_stride: int = 1

    def evaluated_levels(self, sweep: Sweep) -> tuple[float, ...]:
        """Return the evaluated levels of a sweep: 0 first, the largest last."""
        return (0.0, *sweep.levels[:: -self.level_stride][::-1])

    def jobs(self, sweep: Sweep, level: float) -> list[Job]:
        """Return one job per foot at a level of a sweep."""
        with_network = sweep in TEST_STAND_SWEEPS
        return [
            Job(sweep.tolerances_at(level), foot, with_network)
            for foot in range(self.n_test_stand_feet_per_level if with_network else self.n_feet_per_level)
        ]


FULL_PLAN = Plan(n_feet_per_level=40, n_test_stand_feet_per_level=20, epochs=EPOCHS)
QUICK_PLAN = Plan(n_feet_per_level=2, n_test_stand_feet_per_level=2, epochs=QUICK_EPOCHS, level_stride=4)


@dataclass(frozen=True, kw_only=True)
class SweepResults:
    """Figures of all evaluated feet, with statistics by sweep and level.

    Attributes:
        plan: Feet and levels.
        designed_gap_um: The designed gap [um].
        statistics_by_sweep_and_level: By sweep, level and name, as `estimator_errors` names them.
    """

    plan: Plan
    designed_gap_um: float
    statistics_by_sweep_and_level: dict[str, dict[str, dict[str, MeanStd]]]

    def statistics_over_feet(self, sweep: Sweep, level: float, name: str) -> MeanStd:
        """Return mean and standard deviation of a figure over the feet at a level."""
        return self.statistics_by_sweep_and_level[sweep.varied_quantity][f"{level:g}"][name]

    def means_by_level(self, sweep: Sweep, name: str) -> list[float]:
        """Return a figure's mean over the feet, for each level of a sweep."""
        return [
            self.statistics_over_feet(sweep, level, name).mean for level in self.plan.evaluated_levels(sweep)
        ]

    def interpolated_mean(self, sweep: Sweep, name: str, level: float) -> float:
        """Return a figure's mean over the feet at any level, by linear interpolation."""
        return float(np.interp(level, self.plan.evaluated_levels(sweep), self.means_by_level(sweep, name)))

    def level_reaching(self, sweep: Sweep, name: str, target: float) -> float | None:
        """Return the lowest level at which a figure's mean reaches a target, interpolated; None if never."""
        levels, means = self.plan.evaluated_levels(sweep), self.means_by_level(sweep, name)
        for k, mean in enumerate(means):
            if mean >= target:
                return float(np.interp(target, means[k - 1 : k + 1], levels[k - 1 : k + 1])) if k else 0.0
        return None


def sweep_results(
    models: Path, gap_um: float, plan: Plan, workers: JobRunner, file: Path | None = None
) -> SweepResults:
    """Return the results of a plan, evaluating the feet that are missing in the result file.

    Args:
        models: Folder of the released models; workers elsewhere need it under the same path.
        gap_um: The designed gap [um].
        plan: Feet and levels.
        workers: Run the jobs.
        file: Where results are kept, to go on with later; None keeps none.
    """
    models = models.resolve()
    digests = [
        hashlib.sha256((models / f).read_bytes()).hexdigest()[:12] for f in (RESPONSE_FILE, NETWORK_FILE)
    ]
    about: dict[str, str | int] = {
        "study": "tolerance",
        "seed": SEED,
        "epochs": plan.epochs,
        "models": " ".join(digests),
    }
    work = partial(estimator_errors, models=models, seed=SEED, epochs=plan.epochs)
    jobs = [
        job
        for s in (*FOOT_SWEEPS, *TEST_STAND_SWEEPS)
        for level in plan.evaluated_levels(s)
        for job in plan.jobs(s, level)
    ]
    found = run_resumable(about, jobs, work, workers=workers, file=file)
    figures: dict[str, dict[str, dict[str, MeanStd]]] = {}
    for sweep in (*FOOT_SWEEPS, *TEST_STAND_SWEEPS):
        for level in plan.evaluated_levels(sweep):
            feet = [found[job] for job in plan.jobs(sweep, level)]
            over_feet = {name: MeanStd.of_values(foot[name] for foot in feet) for name in feet[0]}
            figures.setdefault(sweep.varied_quantity, {})[f"{level:g}"] = over_feet
    return SweepResults(plan=plan, designed_gap_um=gap_um, statistics_by_sweep_and_level=figures)
