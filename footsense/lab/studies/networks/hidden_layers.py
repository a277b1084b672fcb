"""Study `hidden-layers` (section III G, Figs. 11 and 12): how many hidden layers, and how many neurons in them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from footsense.foot.response_table import FootResponse
from footsense.lab.evaluation.evaluate import PAPER_DIRECTION_DEG, PAPER_MAGNITUDE_GF, Readout, errors
from footsense.lab.monte_carlo.statistics import Spread
from footsense.lab.studies.page import Page, Workbench, table
from footsense.lab.training.load_cases import paper_training, paper_verification
from footsense.lab.training.mlp import start_layers
from footsense.lab.training.paper_procedure import EPOCHS, QUICK_EPOCHS, Lesson, verification_at

#: Neurons of each hidden layer.
NEURONS, QUICK_NEURONS = (3, 5, 8, 12, 18, 27, 40), (3, 12, 40)
#: Networks of each size, which differ in their start weights.
SEEDS, QUICK_SEEDS = 20, 3
#: A difference counts from this many of its standard errors on.
SURE = 2.0
#: The magnitudes that are taught [gf].
TAUGHT_GF = (50.0, 150.0)

_FIGURE = "hidden-layers.png"
_DEPTHS = {1: "one hidden layer", 2: "two hidden layers"}
#: What is measured of each network, as a mean over cases: its name, its words, the paper's figure.
_MEASURED = (
    ("direction_deg", "direction, 100 gf [deg]", PAPER_DIRECTION_DEG),
    ("magnitude_gf", "magnitude, 100 gf [gf]", PAPER_MAGNITUDE_GF),
    ("taught_deg", "direction, 50 and 150 gf [deg]", None),
)

#: Spreads over the seeds, of each size, by what is measured and by depth.
Results = dict[str, dict[int, list[Spread]]]


def n_weights(depth: int, neurons: int) -> int:
    """Return how many numbers a network learns.

    Example:
        >>> n_weights(1, 18), n_weights(2, 18)
        (237, 579)
    """
    widths = np.array([9, *[neurons] * depth, 3])
    return int(((widths[:-1] + 1) * widths[1:]).sum())


def _taught(lesson: Lesson, depth: int, neurons: Sequence[int], seeds: int, epochs: int) -> list[Readout]:
    """Return networks of one depth, size by size; all learn in one program, padded to the largest."""
    room = (9, *[max(neurons)] * depth, 3)
    starts = [
        start_layers(np.random.default_rng(seed), (9, *[n] * depth, 3), room)
        for n in neurons
        for seed in range(seeds)
    ]
    return lesson.teach(starts, epochs)


def _examined(response: FootResponse, readouts: Sequence[Readout], seeds: int) -> dict[str, list[Spread]]:
    """Return what is measured of networks, size by size."""
    paper, *taught = [paper_verification(response), *(verification_at(response, m) for m in TAUGHT_GF)]
    at_paper = [errors(paper.force_n, read(paper.closure_um)) for read in readouts]
    measured = {
        "direction_deg": [row.direction_deg for row in at_paper],
        "magnitude_gf": [row.magnitude_gf for row in at_paper],
        "taught_deg": [
            float(np.mean([errors(cases.force_n, read(cases.closure_um)).direction_deg for cases in taught]))
            for read in readouts
        ],
    }
    return {
        name: [Spread.over(figures[k : k + seeds]) for k in range(0, len(figures), seeds)]
        for name, figures in measured.items()
    }


def _figure(neurons: Sequence[int], results: Results) -> Figure:
    """Return each error over the neurons, with the deviation between seeds as a band."""
    figure = Figure(figsize=(8.2, 3.4), layout="constrained")
    panels = figure.subplots(1, len(_MEASURED))
    for axes, (name, words, paper) in zip(panels, _MEASURED, strict=True):
        for depth, what in _DEPTHS.items():
            mean = np.array([spread.mean for spread in results[name][depth]])
            deviation = np.array([spread.deviation for spread in results[name][depth]])
            colour = f"C{depth - 1}"
            axes.plot(neurons, mean, "o-", color=colour, ms=4, label=what)
            axes.fill_between(neurons, mean - deviation, mean + deviation, color=colour, alpha=0.2, lw=0)
        if paper is not None:
            axes.axhline(paper, color="k", ls=":", label="the paper")
        axes.set(xscale="log", xlabel="neurons in each hidden layer")
        axes.set_title(words, fontsize=10)
        axes.set_xticks(neurons, [str(n) for n in neurons])
        axes.minorticks_off()
        axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("mean error")
    panels[1].legend(fontsize=8)
    return figure


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """How much larger one mean over the seeds is than another, in the unit of the figure.

    Attributes:
        excess: The difference.
        error: Its standard error.
    """

    excess: float
    error: float

    @property
    def sign(self) -> int:
        """Whether the first mean is larger (1) or smaller (-1) by more than chance, or neither (0)."""
        return int(np.sign(self.excess)) if abs(self.excess) > SURE * self.error else 0

    def __str__(self) -> str:
        if self.excess == 0.0:
            return "is the best"
        text = f"{self.excess:+.2f} ± {self.error:.2f}"
        return f"**{text}**" if self.sign else text


def _differences(neurons: Sequence[int], spreads: dict[int, list[Spread]]) -> dict[str, Difference]:
    """Return what the paper's statements say is above zero: five differences of means by their names."""
    best = {depth: min(some, key=lambda spread: spread.mean) for depth, some in spreads.items()}
    pairs = {"one layer at its best, less two at theirs": (best[1], best[2])}
    for depth, name in _DEPTHS.items():
        for k, what in ((0, "fewest"), (-1, "most")):
            pairs[f"{name}: {what} neurons ({neurons[k]}), less the best"] = (spreads[depth][k], best[depth])
    differences = {}
    for name, (larger, smaller) in pairs.items():
        excess, error = larger.excess(smaller)
        differences[name] = Difference(excess=excess, error=error)
    return differences


def _holds(differences: Sequence[Difference]) -> str:
    """Put into words in how many comparisons a statement holds."""
    signs = [difference.sign for difference in differences]
    text = f"so in {signs.count(1)} of {len(signs)} comparisons"
    return text + (f", the other way round in {signs.count(-1)}" if -1 in signs else "")


def _findings(neurons: Sequence[int], results: Results) -> str:
    """Put the paper's statements to the test."""
    columns = [_differences(neurons, results[name]) for name, _, _ in _MEASURED]
    rows = [[name, *(str(column[name]) for column in columns)] for name in columns[0]]
    layers, few_1, many_1, few_2, many_2 = ([column[name] for column in columns] for name in columns[0])
    return f"""{table(["difference of means ± its standard error", *(words for _, words, _ in _MEASURED)], rows)}

In bold what differs from zero by more than {SURE:g} standard errors. The best size is picked from these same means,
which flatters it.

- *Two layers are better than one*: {_holds(layers)}.
- *Too few neurons are bad*: {_holds([*few_1, *few_2])}.
- *Too many neurons are bad*: {_holds([*many_1, *many_2])}."""


def _values(neurons: Sequence[int], results: Results) -> dict[str, Any]:
    """Return the spreads as JSON values, by what is measured, layers and neurons."""
    return {
        name: {
            f"{depth}": {str(n): spread.json() for n, spread in zip(neurons, spreads, strict=True)}
            for depth, spreads in of_depth.items()
        }
        for name, of_depth in results.items()
    }


def page(bench: Workbench) -> Page:
    """Return the page."""
    quick, response = bench.quick, bench.response
    neurons, seeds = (QUICK_NEURONS, QUICK_SEEDS) if quick else (NEURONS, SEEDS)
    epochs = QUICK_EPOCHS if quick else EPOCHS
    lesson = Lesson(response.design, paper_training(response))
    results: Results = {name: {} for name, _, _ in _MEASURED}
    for depth, what in _DEPTHS.items():
        readouts = _taught(lesson, depth, neurons, seeds, epochs)
        for name, spreads in _examined(response, readouts, seeds).items():
            results[name][depth] = spreads
        bench.say(f"hidden-layers: {len(neurons)} sizes with {what} have learnt, {seeds} seeds each")
    header = [f"{words}, {depth}" for _, words, _ in _MEASURED for depth in _DEPTHS]
    rows = [
        [str(n), *(str(n_weights(depth, n)) for depth in _DEPTHS)]
        + [str(results[name][depth][k]) for name, _, _ in _MEASURED for depth in _DEPTHS]
        for k, n in enumerate(neurons)
    ]
    body = f"""
{"**Quick run: few sizes, seeds and epochs. The figures are not those of the study.**" if quick else ""}

The paper (section III G, Figs. 11 and 12) finds two hidden layers slightly better than one, and both too few and too
many neurons bad. Here: plain networks on ΔC, RPROP, {epochs} epochs on the 362 cases, {seeds} seeds for each size, mean
± deviation between seeds; 1 and 2 are the hidden layers. Asked are the paper's 180 cases with 100 gf, a force that was
not taught, and the same directions with the taught 50 and 150 gf.

{table(["neurons a layer", "weights, 1", "weights, 2", *header], rows)}

![]({_FIGURE})

{_findings(neurons, results)}
"""
    return Page(
        name="hidden-layers",
        title="How many hidden layers and neurons",
        body=body,
        figures={_FIGURE: _figure(neurons, results)},
        values={"quick": quick, "epochs": epochs, "seeds": seeds, **_values(neurons, results)},
    )
