"""Study `tolerance` (section V): what turns the simulated error into the measured one.

The paper measured 15.9 deg and 18.7 gf where it had simulated 2.4 deg and 5.3 gf, and left open why. Here hundreds of
feet are drawn, and what was learnt on the design is judged on them, beside what is learnt anew from their own cases.
"""

import hashlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from footsense.lab.campaign import (
    Figures,
    Job,
    Tolerances,
    Workers,
    in_turn,
    run_campaign,
)
from footsense.lab.evaluate_models import NETWORK_FILE, RESPONSE_FILE
from footsense.lab.paper_way import EPOCHS, QUICK_EPOCHS
from footsense.lab.specimens import judge
from footsense.lab.spread import Spread
from footsense.lab.study.page import Page, Workbench, table

#: The paper's mean errors on its fabricated sensor (section V C) [deg, gf].
MEASURED_DIRECTION_DEG, MEASURED_MAGNITUDE_GF = 15.9, 18.7
#: Of all random numbers of the study.
SEED = 20090304

EXACT = Tolerances()
#: A plausible foot of soft lithography; nobody has published these of the paper's.
TYPICAL = Tolerances(gap_um=1.0, film_um=1.0, stray_pf=0.05, stiffness_rel=0.1, mount_deg=2.0)
#: A careful bench: the paper's meter and reference sensor, and what a hand-set stick may come to.
BENCH = Tolerances(reading_pf=0.001, repeat_rel=0.02, reference_rel=0.5, stick_deg=1.0)

#: Read-outs by the names of `specimens.judge`: learnt on the design, and learnt on the foot.
ON_DESIGN = {"network": "shipped network", "change": "linear on ΔC"}
ON_FOOT = {"own_network": "network on ΔC", "own_change": "linear on ΔC", "own_closure": "linear on closures"}
_COLOURS = {"network": "C0", "change": "C1", "own_network": "C3", "own_change": "C4", "own_closure": "C2"}


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
QUICK = Plan(feet=3, taught=2, epochs=QUICK_EPOCHS, thin=3)


class Results:
    """The figures of every foot of a plan.

    Args:
        plan: What was done.
        of_job: What came out.
    """

    def __init__(self, plan: Plan, of_job: dict[Job, Figures]) -> None:
        self.plan = plan
        self._of_job = of_job

    def over_feet(self, sweep: Sweep, level: float, name: str) -> Spread:
        """Return a figure's mean and spread over the feet of a level."""
        return Spread.over(self._of_job[job][name] for job in self.plan.jobs(sweep, level))

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


def _reached(results: Results, sweep: Sweep, name: str, target: float) -> str:
    """Say at which level a target is reached, or how far the largest level comes."""
    level = results.reached(sweep, name, target)
    if level is not None:
        return f"{level:.3g}"
    return f"no ({results.means(sweep, name)[-1]:.1f} at {sweep.levels[-1]:g})"


def _reached_table(results: Results, sweeps: tuple[Sweep, ...], readouts: dict[str, str]) -> str:
    """Return at which level each imperfection gives the paper's measured errors."""
    header = ["imperfection", *(f"{label}: {MEASURED_DIRECTION_DEG} deg at" for label in readouts.values())]
    header += [f"{label}: {MEASURED_MAGNITUDE_GF} gf at" for label in readouts.values()]
    rows = [
        [sweep.what]
        + [_reached(results, sweep, f"{name}_deg", MEASURED_DIRECTION_DEG) for name in readouts]
        + [_reached(results, sweep, f"{name}_gf", MEASURED_MAGNITUDE_GF) for name in readouts]
        for sweep in sweeps
    ]
    return table(header, rows)


def _level_table(
    results: Results, sweeps: tuple[Sweep, ...], columns: dict[str, str], shares: tuple[str, ...] = ()
) -> str:
    """Return direction / magnitude errors at each level, mean over feet, and shares of components within sigma."""
    rows = []
    for sweep in sweeps:
        for level in results.plan.levels(sweep):
            row = [f"{sweep.what}: {level:g}"]
            for name in columns:
                direction = results.over_feet(sweep, level, f"{name}_deg")
                row.append(f"{direction} / {results.over_feet(sweep, level, f'{name}_gf').mean:.1f}")
            rows.append(row + [f"{results.over_feet(sweep, level, name).mean:.0%}" for name in shares])
    labels = [f"{label} [deg / gf]" for label in columns.values()]
    return table(["imperfection, rms", *labels, *(f"within {name[-1]} sigma" for name in shares)], rows)


def _figure(results: Results, sweeps: tuple[Sweep, ...], readouts: dict[str, str]) -> Figure:
    """Return the mean direction error over the level of each imperfection, deviation between feet as a band."""
    figure = Figure(figsize=(9.0, 5.8), layout="constrained")
    panels = figure.subplots(2, 3, sharey=True).ravel()
    for axes, sweep in zip(panels, sweeps, strict=False):
        levels = results.plan.levels(sweep)
        for name, label in readouts.items():
            spreads = [results.over_feet(sweep, level, f"{name}_deg") for level in levels]
            mean = np.array([spread.mean for spread in spreads])
            deviation = np.array([spread.deviation for spread in spreads])
            axes.plot(levels, mean, "o-", ms=4, color=_COLOURS[name], label=label)
            axes.fill_between(
                levels, mean - deviation, mean + deviation, color=_COLOURS[name], alpha=0.2, lw=0
            )
        axes.axhline(MEASURED_DIRECTION_DEG, color="k", ls=":", label="the paper, measured")
        axes.set(xlabel=f"{sweep.what}, rms", ylim=(0.0, 40.0))
        axes.grid(alpha=0.3)
    for axes in panels[::3]:
        axes.set_ylabel("mean direction error [deg]")
    if len(sweeps) < len(panels):
        panels[-1].axis("off")
        panels[-1].legend(*panels[0].get_legend_handles_labels(), loc="center")
    else:
        panels[0].legend(fontsize=8)
    return figure


def _values(results: Results) -> dict[str, Any]:
    """Return all means and deviations as JSON values, by imperfection, level and figure."""
    names = [f"{name}_{unit}" for name in (*ON_DESIGN, *ON_FOOT, "reference") for unit in ("deg", "gf")]
    values: dict[str, Any] = {}
    for sweep in (*FEET, *BENCHES):
        known = [name for name in names if sweep in BENCHES or not name.startswith("own_network")]
        values[sweep.what] = {
            f"{level:g}": {
                name: results.over_feet(sweep, level, name).json()
                for name in (*known, "within_1", "within_2")
            }
            for level in results.plan.levels(sweep)
        }
    return values


def campaign_page(bench: Workbench, plan: Plan, workers: Workers, file: Path | None = None) -> Page:
    """Return the page of a plan, the feet judged by these workers and kept in this file."""
    results = all_results(bench.models, plan, workers, file)
    bench.say(f"tolerance: {plan.feet} feet at each level of fabrication, {plan.taught} at each of the bench")
    return Page(name="tolerance", title="x", body="x", values=_values(results))


def page(bench: Workbench) -> Page:
    """Return the page."""
    if bench.quick:
        return campaign_page(bench, QUICK, in_turn)
    return campaign_page(bench, FULL, on_cluster() if has_dask() else in_turn)
