"""Study `paper-way`: the paper's network on the paper's cases, many times, and once more on closures."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from footsense.foot.response_table import FootResponse
from footsense.lab.evaluation.evaluate import (
    PAPER_DIRECTION_DEG,
    PAPER_MAGNITUDE_GF,
    Errors,
    Readout,
    capacitance_readout,
    elastance_readout,
    errors,
)
from footsense.lab.monte_carlo.statistics import Spread
from footsense.lab.studies.page import Page, Workbench, table
from footsense.lab.training.load_cases import Cases, paper_training
from footsense.lab.training.paper_procedure import (
    EPOCHS,
    HIDDEN,
    QUICK_EPOCHS,
    Feed,
    paper_way,
    verification_at,
)

#: Magnitudes at which the 180 directions are asked for [gf]; the first and the last are taught, the middle is the
#: paper's.
MAGNITUDES_GF = (50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0, 130.0, 140.0, 150.0)
_PAPERS = MAGNITUDES_GF.index(100.0)

_FIGURE = "paper-way.png"
_COLOURS: dict[Feed, str] = {"capacitance": "C0", "closure": "C1"}
_NAMES: dict[Feed, str] = {"capacitance": "ΔC", "closure": "closures"}


def _examined(read: Readout, asked: list[Cases]) -> list[Errors]:
    """Return a read-out's errors at each magnitude."""
    return [errors(cases.force_n, read(cases.closure_um)) for cases in asked]


class _Answers:
    """What the networks and the linear read-out that are fed with the same said.

    Attributes:
        networks: Errors of each seed at the paper's 100 gf.
        direction_deg: Direction error at each magnitude.
        magnitude_gf: Magnitude error at each magnitude.
        linear: Errors of the linear read-out at 100 gf.
    """

    def __init__(self, response: FootResponse, asked: list[Cases], feed: Feed, *, quick: bool) -> None:
        seeds = [_examined(read, asked) for read in paper_way(response, quick=quick, feed=feed)]
        self.networks = [rows[_PAPERS] for rows in seeds]
        self.direction_deg = [
            Spread.over(row.direction_deg for row in rows) for rows in zip(*seeds, strict=True)
        ]
        self.magnitude_gf = [
            Spread.over(row.magnitude_gf for row in rows) for rows in zip(*seeds, strict=True)
        ]
        training = paper_training(response)
        on_change = capacitance_readout(response.design, training)
        read = on_change if feed == "capacitance" else elastance_readout(training)
        self.linear = _examined(read, asked)[_PAPERS]

    def rows(self, name: str) -> list[list[str]]:
        """Return the rows of the table."""
        at_paper = [str(spread[_PAPERS]) for spread in (self.direction_deg, self.magnitude_gf)]
        linear = [f"{self.linear.direction_deg:.2f}", f"{self.linear.magnitude_gf:.2f}"]
        return [[f"network on {name}", *at_paper], [f"linear read-out of {name}", *linear]]

    def json(self) -> dict[str, Any]:
        """Return the errors as JSON values, by magnitude [gf]."""
        return {
            f"{magnitude:g}": {"direction_deg": direction.json(), "magnitude_gf": size.json()}
            for magnitude, direction, size in zip(
                MAGNITUDES_GF, self.direction_deg, self.magnitude_gf, strict=True
            )
        }


def _figure(answers: dict[Feed, _Answers]) -> Figure:
    """Return every network as a point of its two errors, and the direction error over the magnitude."""
    figure = Figure(figsize=(8.2, 4.0), layout="constrained")
    points, curve = figure.subplots(1, 2)
    for feed, said in answers.items():
        colour, name = _COLOURS[feed], _NAMES[feed]
        direction_deg = [row.direction_deg for row in said.networks]
        magnitude_gf = [row.magnitude_gf for row in said.networks]
        points.plot(direction_deg, magnitude_gf, "o", color=colour, alpha=0.6, label=f"networks on {name}")
        linear = said.linear
        points.plot(
            linear.direction_deg,
            linear.magnitude_gf,
            "X",
            color=colour,
            mec="k",
            ms=9,
            label=f"linear on {name}",
        )
        mean = np.array([spread.mean for spread in said.direction_deg])
        deviation = np.array([spread.deviation for spread in said.direction_deg])
        curve.plot(MAGNITUDES_GF, mean, "o-", color=colour, ms=4, label=f"networks on {name}")
        curve.fill_between(MAGNITUDES_GF, mean - deviation, mean + deviation, color=colour, alpha=0.2, lw=0)
    points.plot(PAPER_DIRECTION_DEG, PAPER_MAGNITUDE_GF, "k*", ms=13, label="the paper")
    points.set(xscale="log", yscale="log", title="180 directions at 100 gf")
    points.set(xlabel="mean direction error [deg]", ylabel="mean magnitude error [gf]")
    for axis in (points.xaxis, points.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    points.legend(fontsize=8)
    for taught_gf in (MAGNITUDES_GF[0], MAGNITUDES_GF[-1]):
        curve.axvline(taught_gf, color="k", ls=":", label="taught" if taught_gf == MAGNITUDES_GF[0] else None)
    curve.set(title="the same directions, other forces", ylim=(0.0, None))
    curve.legend(fontsize=8)
    curve.set(xlabel="force [gf]", ylabel="mean direction error [deg]")
    for axes in (points, curve):
        axes.grid(alpha=0.3)
    return figure


def _place(paper: float, ours: Spread, unit: str) -> str:
    """Say where the paper's figure lies among those of the seeds."""
    span = f"ours, {ours.lowest:.2f} to {ours.highest:.2f} {unit}"
    if paper < ours.lowest:
        return f"below all of {span}"
    return f"above all of {span}" if paper > ours.highest else f"among {span}"


def page(bench: Workbench) -> Page:
    """Return the page."""
    response, quick = bench.response, bench.quick
    asked = [verification_at(response, magnitude_gf) for magnitude_gf in MAGNITUDES_GF]
    answers: dict[Feed, _Answers] = {}
    for feed, name in _NAMES.items():
        answers[feed] = _Answers(response, asked, feed, quick=quick)
        bench.say(f"paper-way: {len(answers[feed].networks)} networks on {name} have learnt")
    ours, elastic = answers["capacitance"], answers["closure"]
    direction, magnitude = ours.direction_deg[_PAPERS], ours.magnitude_gf[_PAPERS]
    epochs = QUICK_EPOCHS if quick else EPOCHS
    paper = ["the paper (simulation), one network on ΔC", f"{PAPER_DIRECTION_DEG}", f"{PAPER_MAGNITUDE_GF}"]
    rows = [paper, *(row for feed, name in _NAMES.items() for row in answers[feed].rows(name))]
    body = f"""
{"**Quick run: few seeds, few epochs. The figures are not those of the study.**" if quick else ""}

What does the paper's own way (section III F) reach on our foot? A plain network 9-{HIDDEN[0]}-{HIDDEN[1]}-3, tanh,
RPROP, {epochs} epochs on the 362 cases with 50 and 150 gf, asked for the 180 cases with 100 gf; {direction.n} networks
that differ in their start weights alone. Then the same network fed with gap closures, which are what the elastance
1/C measures: all that this changes is the curve on each input.

{table(["mean over the 180 cases ± deviation between seeds", "direction [deg]", "magnitude [gf]"], rows)}

![]({_FIGURE})

- The paper's {PAPER_DIRECTION_DEG} deg are {_place(PAPER_DIRECTION_DEG, direction, "deg")}, its {PAPER_MAGNITUDE_GF} gf
  {_place(PAPER_MAGNITUDE_GF, magnitude, "gf")}. The start weights alone change our direction error by a
  factor of {direction.highest / direction.lowest:.1f}, so a single network tells little.
- What a force costs that was not taught: for the same 180 directions, none of them taught, the networks on ΔC err by
  {ours.direction_deg[0].mean:.2f} deg at the taught 50 gf, {direction.mean:.2f} deg at 100 gf and
  {ours.direction_deg[-1].mean:.2f} deg at the taught 150 gf.
- Closures instead of ΔC change the direction error at 100 gf by a factor of
  {elastic.direction_deg[_PAPERS].mean / direction.mean:.2f} and the magnitude error by
  {elastic.magnitude_gf[_PAPERS].mean / magnitude.mean:.2f}; those of the linear read-outs by
  {elastic.linear.direction_deg / ours.linear.direction_deg:.2f} and
  {elastic.linear.magnitude_gf / ours.linear.magnitude_gf:.2f}.
"""
    return Page(
        name="paper-way",
        title="The paper's own way",
        body=body,
        figures={_FIGURE: _figure(answers)},
        values={
            "quick": quick,
            "epochs": epochs,
            "hidden": list(HIDDEN),
            "by_force_gf": {feed: said.json() for feed, said in answers.items()},
        },
    )
