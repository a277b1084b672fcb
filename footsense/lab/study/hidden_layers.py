"""Study `hidden-layers` (section III G, Figs. 11 and 12): how many hidden layers, and how many neurons in them."""

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from footsense.lab.dataset import Cases, paper_training, paper_verification
from footsense.lab.evaluate import PAPER_DIRECTION_DEG, PAPER_MAGNITUDE_GF, errors
from footsense.lab.mlp import start_layers
from footsense.lab.paper_way import EPOCHS, QUICK_EPOCHS, Lesson
from footsense.lab.spread import Spread
from footsense.lab.study.page import Page, Workbench, table

#: Neurons of each hidden layer.
NEURONS, QUICK_NEURONS = (3, 5, 8, 12, 18, 27, 40), (3, 12, 40)
#: Networks of each size, which differ in their start weights.
SEEDS, QUICK_SEEDS = 20, 3
#: A difference counts from this many of its standard errors on.
SURE = 2.0

_FIGURE = "hidden-layers.png"
_DEPTHS = {1: "one hidden layer", 2: "two hidden layers"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """Errors of one size of network over the seeds, mean of the 180 cases each.

    Attributes:
        direction_deg: Direction error [deg].
        magnitude_gf: Magnitude error [gf].
    """

    direction_deg: Spread
    magnitude_gf: Spread


def n_weights(depth: int, neurons: int) -> int:
    """Return how many numbers a network learns.

    Example:
        >>> n_weights(1, 18), n_weights(2, 18)
        (237, 579)
    """
    widths = np.array([9, *[neurons] * depth, 3])
    return int(((widths[:-1] + 1) * widths[1:]).sum())


def _sweep(
    lesson: Lesson, asked: Cases, depth: int, neurons: tuple[int, ...], seeds: int, epochs: int
) -> list[Result]:
    """Return the results of networks of one depth; all sizes learn in one program, padded to the largest."""
    room = (9, *[max(neurons)] * depth, 3)
    starts = [
        start_layers(np.random.default_rng(seed), (9, *[n] * depth, 3), room)
        for n in neurons
        for seed in range(seeds)
    ]
    rows = [errors(asked.force_n, read(asked.closure_um)) for read in lesson.teach(starts, epochs)]
    of_size = [rows[k * seeds : (k + 1) * seeds] for k in range(len(neurons))]
    return [
        Result(
            direction_deg=Spread.over(row.direction_deg for row in some),
            magnitude_gf=Spread.over(row.magnitude_gf for row in some),
        )
        for some in of_size
    ]


def _figure(neurons: tuple[int, ...], results: dict[int, list[Result]]) -> Figure:
    """Return direction and magnitude error over the neurons, with the deviation between seeds as a band."""
    figure = Figure(figsize=(8.2, 3.9), layout="constrained")
    panels = figure.subplots(1, 2)
    labels = (
        ("direction_deg", "mean direction error [deg]", PAPER_DIRECTION_DEG),
        ("magnitude_gf", "mean magnitude error [gf]", PAPER_MAGNITUDE_GF),
    )
    for axes, (name, label, paper) in zip(panels, labels, strict=True):
        for depth, what in _DEPTHS.items():
            spreads = [getattr(result, name) for result in results[depth]]
            mean = np.array([spread.mean for spread in spreads])
            deviation = np.array([spread.deviation for spread in spreads])
            axes.plot(neurons, mean, "o-", color=f"C{depth - 1}", label=what)
            axes.fill_between(
                neurons, mean - deviation, mean + deviation, color=f"C{depth - 1}", alpha=0.2, lw=0
            )
        axes.axhline(paper, color="k", ls=":", label="the paper, two layers")
        axes.set(xscale="log", xlabel="neurons in each hidden layer", ylabel=label)
        axes.set_xticks(neurons, [str(n) for n in neurons])
        axes.minorticks_off()
        axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=8)
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
    def is_sure(self) -> bool:
        """Whether the first mean is larger by more than chance."""
        return self.excess > SURE * self.error

    def __str__(self) -> str:
        if self.excess == 0.0:
            return "is the best"
        text = f"{self.excess:+.2f} ± {self.error:.2f}"
        return f"**{text}**" if self.is_sure else text


def _differences(neurons: tuple[int, ...], spreads: dict[int, list[Spread]]) -> dict[str, Difference]:
    """Return what the paper's two statements say is above zero: five differences of means by their names."""
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


def _holds(sure: list[bool]) -> str:
    """Put into words how many of a statement's differences are there."""
    if all(sure):
        return "holds"
    return f"holds in {sum(sure)} of {len(sure)} comparisons" if any(sure) else "not to be seen"


def _findings(neurons: tuple[int, ...], results: dict[int, list[Result]]) -> str:
    """Put both of the paper's statements to the test."""
    direction, magnitude = (
        _differences(neurons, {depth: [getattr(r, name) for r in some] for depth, some in results.items()})
        for name in ("direction_deg", "magnitude_gf")
    )
    rows = [[name, str(direction[name]), str(magnitude[name])] for name in direction]
    layers, *ends = zip(direction.values(), magnitude.values(), strict=True)
    few = [difference.is_sure for pair in ends[0::2] for difference in pair]
    many = [difference.is_sure for pair in ends[1::2] for difference in pair]
    return f"""{table(["difference of means ± its standard error", "direction [deg]", "magnitude [gf]"], rows)}

In bold what is above zero by more than {SURE:g} standard errors. The best size is picked from these same means, which
flatters it.

- *Two layers are better than one*: {_holds([difference.is_sure for difference in layers])}.
- *Too few neurons are bad*: {_holds(few)}.
- *Too many neurons are bad*: {_holds(many)}."""


def page(bench: Workbench) -> Page:
    """Return the page."""
    quick = bench.quick
    neurons, seeds = (QUICK_NEURONS, QUICK_SEEDS) if quick else (NEURONS, SEEDS)
    epochs = QUICK_EPOCHS if quick else EPOCHS
    response = bench.response
    lesson, asked = Lesson(response.design, paper_training(response)), paper_verification(response)
    results = {}
    for depth, what in _DEPTHS.items():
        results[depth] = _sweep(lesson, asked, depth, neurons, seeds, epochs)
        bench.say(f"hidden-layers: {len(neurons)} sizes with {what} have learnt, {seeds} seeds each")
    rows = [
        [str(n), *(f"{n_weights(depth, n)}" for depth in _DEPTHS)]
        + [str(results[depth][k].direction_deg) for depth in _DEPTHS]
        + [str(results[depth][k].magnitude_gf) for depth in _DEPTHS]
        for k, n in enumerate(neurons)
    ]
    header = [
        "neurons a layer",
        "weights, 1",
        "weights, 2",
        "1 layer [deg]",
        "2 layers [deg]",
        "1 layer [gf]",
    ]
    body = f"""
{"**Quick run: few sizes, seeds and epochs. The figures are not those of the study.**" if quick else ""}

The paper (section III G, Figs. 11 and 12) finds two hidden layers slightly better than one, and both too few and too
many neurons bad. Here: plain networks on ΔC, RPROP, {epochs} epochs on the 362 cases, asked for the 180; {seeds} seeds
for each size, mean ± deviation between seeds.

{table([*header, "2 layers [gf]"], rows)}

![]({_FIGURE})

{_findings(neurons, results)}
"""
    values = {
        f"{depth}": {
            str(n): {"direction_deg": result.direction_deg.json(), "magnitude_gf": result.magnitude_gf.json()}
            for n, result in zip(neurons, results[depth], strict=True)
        }
        for depth in _DEPTHS
    }
    return Page(
        name="hidden-layers",
        title="How many hidden layers and neurons",
        body=body,
        figures={_FIGURE: _figure(neurons, results)},
        values={"quick": quick, "epochs": epochs, "seeds": seeds, "layers": values},
    )
