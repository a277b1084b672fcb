"""What of fabrication and calibration is made worse, step by step, and the figures over the feet of each step."""

import hashlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from footsense.lab.evaluation.evaluate_models import NETWORK_FILE, RESPONSE_FILE
from footsense.lab.monte_carlo.campaign import Figures, Job, Tolerances, Workers, run_campaign
from footsense.lab.monte_carlo.specimens import judge
from footsense.lab.monte_carlo.statistics import MeanStd
from footsense.lab.training.paper_procedure import EPOCHS, QUICK_EPOCHS

#: Of all random numbers of the study.
SEED = 20090304

EXACT = Tolerances()
#: A plausible foot of soft lithography; nobody has published these of the paper's.
TYPICAL = Tolerances(gap_um=1.0, film_um=1.0, stray_pf=0.05, stiffness_rel=0.1, mount_deg=2.0)
#: A careful bench: the paper's meter and reference sensor, and what a hand-set stick may come to.
BENCH = Tolerances(reading_pf=0.001, repeat_rel=0.02, reference_rel=0.5, stick_deg=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """One kind of imperfection at several levels.

    Attributes:
        what: What it is, with the unit of its levels.
        step: Tolerances at level 1.
        levels: Levels, rising, without 0.
        base: What is there at every level.
    """

    what: str
    step: Tolerances
    levels: tuple[float, ...]
    base: Tolerances = EXACT

    def at(self, level: float) -> Tolerances:
        """Return the tolerances at a level."""
        return self.base.plus(self.step, level)


FEET = (
    Sweep(what="gap [um]", step=Tolerances(gap_um=1.0), levels=(0.5, 1.0, 2.0, 3.0, 5.0, 8.0)),
    Sweep(what="unknown stray [pF]", step=Tolerances(stray_pf=1.0), levels=(0.05, 0.1, 0.2, 0.5, 1.0)),
    Sweep(what="stiffness [%]", step=Tolerances(stiffness_rel=0.01), levels=(5.0, 10.0, 20.0, 40.0)),
    Sweep(what="mount [deg]", step=Tolerances(mount_deg=1.0), levels=(1.0, 2.0, 5.0, 10.0)),
    Sweep(what="film [um]", step=Tolerances(film_um=1.0), levels=(0.5, 1.0, 2.0, 4.0)),
    Sweep(what="all, times typical", step=TYPICAL, levels=(0.5, 1.0, 2.0, 3.0, 5.0)),
)
BENCHES = (
    Sweep(what="reading [fF]", step=Tolerances(reading_pf=0.001), levels=(1.0, 5.0, 20.0)),
    Sweep(what="repeatability of ΔC [%]", step=Tolerances(repeat_rel=0.01), levels=(2.0, 5.0, 20.0)),
    Sweep(what="reference [resolutions]", step=Tolerances(reference_rel=1.0), levels=(0.5, 1.0, 3.0)),
    Sweep(what="stick [deg]", step=Tolerances(stick_deg=1.0), levels=(1.0, 2.0, 5.0, 8.0)),
    Sweep(what="all of it, times careful", step=BENCH, levels=(1.0, 2.0, 4.0), base=TYPICAL),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """How much is done.

    Attributes:
        feet: Feet at every level.
        taught: Feet at every level of the bench, which also teach a network; at least 2.
        epochs: That such a network learns.
        thin: Every how many-th level is done.
    """

    feet: int
    taught: int
    epochs: int
    thin: int = 1

    def levels(self, sweep: Sweep) -> tuple[float, ...]:
        """Return the levels of a sweep, the one without it first and the largest last."""
        return (0.0, *sweep.levels[:: -self.thin][::-1])

    def jobs(self, sweep: Sweep, level: float) -> list[Job]:
        """Return the feet of a level."""
        taught = sweep in BENCHES
        return [Job(sweep.at(level), foot, taught) for foot in range(self.taught if taught else self.feet)]


FULL = Plan(feet=40, taught=20, epochs=EPOCHS)
QUICK = Plan(feet=2, taught=2, epochs=QUICK_EPOCHS, thin=4)


class Results:
    """The figures of every foot of a plan.

    Args:
        plan: What was done.
        of_job: What came out.
    """

    def __init__(self, plan: Plan, of_job: dict[Job, Figures]) -> None:
        self.plan = plan
        self._of_job = of_job

    def over_feet(self, sweep: Sweep, level: float, name: str) -> MeanStd:
        """Return a figure's mean and spread over the feet of a level."""
        return MeanStd.over(self._of_job[job][name] for job in self.plan.jobs(sweep, level))

    def means(self, sweep: Sweep, name: str) -> list[float]:
        """Return a figure's mean over the feet at each level."""
        return [self.over_feet(sweep, level, name).mean for level in self.plan.levels(sweep)]

    def reached(self, sweep: Sweep, name: str, target: float) -> float | None:
        """Return the lowest level at which a mean reaches a target, on straight lines between levels."""
        levels, means = self.plan.levels(sweep), self.means(sweep, name)
        for k, mean in enumerate(means):
            if mean >= target:
                return float(np.interp(target, means[k - 1 : k + 1], levels[k - 1 : k + 1])) if k else 0.0
        return None


def all_results(models: Path, plan: Plan, workers: Workers, file: Path | None = None) -> Results:
    """Judge all feet of a plan that the file does not know yet.

    Args:
        models: Folder of the released models; workers elsewhere need it under the same path.
        plan: How much.
        workers: Who does it.
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
    work = partial(judge, models=models, seed=SEED, epochs=plan.epochs)
    jobs = [job for s in (*FEET, *BENCHES) for level in plan.levels(s) for job in plan.jobs(s, level)]
    return Results(plan, run_campaign(about, jobs, work, workers=workers, file=file))
