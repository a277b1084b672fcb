"""`footsense lab experiment`: the paper's experiment on feet that were never made."""

import json
import os
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from footsense.cli.lab.options import require_writable, stopwatch_report
from footsense.daemon.foot_types import models_folder
from footsense.errors import FootsenseError
from footsense.sim.foot.fabrication import AS_BADLY_MADE
from footsense.validation.test_stand_trial import FootBatch
from footsense.validation.virtual_experiment import ALL, FEW, FootResult, run_experiment

if TYPE_CHECKING:
    from collections.abc import Callable

    from footsense.lab.studies.page import Page, StudyContext

#: Feet of a full run, and of a quick one with one of so many presses.
_FEET, _QUICK_FEET, _QUICK_EVERY = 20, 2, 7
#: Epochs that a network without physics learns in a quick run.
_QUICK_EPOCHS = 500

_CALIBRATED = [f"calibrated_{n}" for n in (*FEW, ALL)]
_WAYS = ["design_only", *_CALIBRATED, "linear_per_foot", "network_per_foot"]


@click.command()
@click.option(
    "--feet", "n_feet", type=click.IntRange(min=1), help=f"How many; {_FEET}, {_QUICK_FEET} if quick."
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=FootBatch().seed,
    show_default=True,
    help="Of all that is drawn.",
)
@click.option("--jobs", type=click.IntRange(min=1), help="Feet at a time; without it one for each processor.")
@click.option("--foot-type", help="A foot type, or its folder as `lab build --foot` makes it.")
@click.option("--quick", is_flag=True, help="Two feet and a seventh of the presses, in a minute.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, and nothing else.")
@click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the page; without it ./docs/report, a quick one ./docs/report-quick.",
)
def experiment(
    *,
    n_feet: int | None,
    seed: int,
    jobs: int | None,
    foot_type: str | None,
    quick: bool,
    as_json: bool,
    output: Path | None,
) -> None:
    """Make feet as badly as the paper's, press, record and calibrate them, and evaluate all estimators.

    Every foot is read by the daemon through the bytes of its chips, and pressed at the paper's 362 and 180 loads beside
    a simulated reference sensor.
    """
    folder = output or Path("docs") / ("report-quick" if quick else "report")
    require_writable(folder)
    from footsense.lab.report import bind, timed_page
    from footsense.lab.studies.page import StudyContext

    batch = FootBatch(seed=seed, foot_type=foot_type or FootBatch().foot_type)
    say: Callable[[str], None] = (lambda _: None) if as_json else stopwatch_report()
    bench = StudyContext(models=models_folder(batch.foot_type), quick=quick, say=say)
    n_feet = n_feet or (_QUICK_FEET if quick else _FEET)
    page = timed_page(lambda bench: page_of(bench, batch, n_feet, jobs or os.cpu_count() or 1), bench)
    page.write(folder)
    if foot_type is None:
        bind(folder, bench)
    click.echo(json.dumps(page.values, indent=2) if as_json else page.markdown)
    say(f"wrote {folder / page.name}.md")


def page_of(bench: "StudyContext", batch: FootBatch, n_feet: int, jobs: int) -> "Page":
    """Press, calibrate and evaluate feet, and return the page of the report."""
    from footsense.lab.training.paper_procedure import EPOCHS
    from footsense.lab.training.per_foot_network import per_foot_force_n

    every = _QUICK_EVERY if bench.quick else 1
    scratch = partial(
        per_foot_force_n, bench.response.design, epochs=_QUICK_EPOCHS if bench.quick else EPOCHS
    )
    judged: list[FootResult] = []
    for one in run_experiment(batch, range(n_feet), scratch, jobs=jobs, every=every):
        judged.append(one)
        bench.say(_line(one))
    judged.sort(key=lambda one: one.foot)
    told = {
        "seed": batch.seed,
        "foot_type": batch.foot_type,
        "made": asdict(AS_BADLY_MADE),
        "every": every,
    }
    return _page(judged, figures(judged) | told)


def figures(judged: list[FootResult]) -> dict[str, Any]:
    """Return mean and spread over the feet of every way's errors, and what was done for them.

    Raises:
        FootsenseError: No foot could be judged.
    """
    if not judged:
        raise FootsenseError("no foot was judged")
    found: dict[str, Any] = {}
    for way in _WAYS:
        wrong = [one.errors[way] for one in judged if way in one.errors]
        if wrong:
            found[way] = {
                "direction_deg": _spread([one.direction_deg for one in wrong]),
                "magnitude_gf": _spread([one.magnitude_gf for one in wrong]),
                "true_direction_deg": _spread([one.true_direction_deg for one in wrong]),
                "true_magnitude_gf": _spread([one.true_magnitude_gf for one in wrong]),
                "feet": len(wrong),
            }
    return found | {
        "feet": len(judged),
        "training_loads": _spread([one.n_training for one in judged]),
        "test_loads": _spread([one.n_test for one in judged]),
        "unread_loads": _spread([one.n_unread for one in judged]),
        "calibrate_s": _spread([one.calibrate_s for one in judged]),
        "refused": {one.foot: one.refused for one in judged if one.refused},
    }


def _spread(values: list[float] | list[int]) -> dict[str, float]:
    """Return the mean over feet and the standard deviation between them."""
    return {"mean": round(float(np.mean(values)), 3), "spread": round(float(np.std(values)), 3)}


def _line(one: FootResult) -> str:
    before, after = one.errors["design_only"], one.errors.get(f"calibrated_{ALL}")
    told = "refused" if after is None else f"{after.direction_deg:.2f} deg, {after.magnitude_gf:.2f} gf"
    return (
        f"{one.foot}: {one.n_training} loads, design {before.direction_deg:.1f} deg, {before.magnitude_gf:.1f} gf; "
        f"calibrated {told}, {one.n_unread} of {one.n_test + one.n_unread} not read"
    )


def _page(judged: list[FootResult], values: dict[str, Any]) -> "Page":
    """Return the page of the report.

    Args:
        judged: The feet.
        values: As of `figures`, and what the run was told.
    """
    from footsense.cli.lab.experiment_figure import few_shot
    from footsense.lab.studies.page import Page, table

    def cell(way: str, what: str) -> str:
        entry = values[way][what]
        return f"{entry['mean']:.2f} ± {entry['spread']:.2f}"

    ways = [way for way in _WAYS if way in values]
    names = {
        "design_only": "network of the design alone",
        "linear_per_foot": "linear in ΔC, the foot's own loads",
    }
    names["network_per_foot"] = "network on ΔC, the foot's own loads"
    names |= {f"calibrated_{n}": f"calibrated with {n} loads" for n in FEW}
    names[f"calibrated_{ALL}"] = "calibrated with all loads"
    columns = ("direction_deg", "magnitude_gf", "true_direction_deg", "true_magnitude_gf")
    rows = [[names[way], *(cell(way, what) for what in columns), str(values[way]["feet"])] for way in ways]
    header = ["read by", "deg", "gf", "deg, true", "gf, true", "feet"]
    own = values["made"]
    made = (
        f"{own['gap_um']:g} um of each gap, {own['film_um']:g} um of each film, {own['stray_pf']:g} pF of stray beside "
        f"each element that nobody knows of,\n{own['stiffness_rel']:.0%} of the stiffness and "
        f"{own['mount_deg']:g} deg of the mount"
    )
    quick = f"**Quick: one of {values['every']} presses.** " if (values["every"] > 1) else ""
    learnt, unread = values["training_loads"]["mean"], values["unread_loads"]["mean"]
    took = values["calibrate_s"]
    refused = [
        f"{foot}, {way}: {why}" for foot, ways in values["refused"].items() for way, why in ways.items()
    ]
    notes = "\n".join(f"- {line}" for line in refused)
    body = f"""
{quick}The paper's network came to 2.4 deg / 5.3 gf in simulation, and to 15.9 deg / 18.7 gf on the foot that was made
(section V C). Here {values["feet"]} feet are drawn that are as badly made, with rms deviations of
{made}. Their rubber creeps and lags, gaps shut, converters are noisy and off in their clocks. These levels are
chosen so that the network of the design, which knows nothing of the foot, is as wrong as the paper's was: that is the
yardstick.

Each foot is pressed on a simulated test stand at the paper's 362 loads (50 and 150 gf) and, mounted anew, at its 180
(100 gf), read by the daemon through the bytes of its chips, beside a simulated three-axis sensor (4/4/8 kgf, steps of
4/4/12 gf, 1.5 % linearity, a clock of its own), and recorded. The first session is calibrated with all its loads, and
with the 5 to 100 that cover the forces best; all are judged by the second. Means over feet, ± the deviation between
them. Errors are those against the reference, as in the paper, whose own gain is off by up to 4 % there; *true*: against
the simulator's true force.

{table(header, rows)}

![](experiment.png)

- Of 362 presses {learnt:.0f} count on average: on soft feet the heavier ones go beyond the converter's range. Of the
  180, {unread:.1f} are beyond what some way can read, and are left out for all.
- From a recording to a foot's parameters: {took["mean"]:.1f} ± {took["spread"]:.1f} s.
{notes}
"""
    return Page(
        name="experiment",
        title="The experiment, on feet that were never made",
        command="experiment" + (" --quick" if (values["every"] > 1) else ""),
        body=body,
        figures={"experiment.png": few_shot(judged)},
        values=values,
    )
