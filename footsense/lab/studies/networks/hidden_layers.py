"""Study `hidden-layers`: network error by number of hidden layers and by neurons per layer.

Source:
    Aoyagi et al., section III G, Figs. 11 and 12.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from footsense.foot.force_errors import evaluate_force_errors
from footsense.lab.evaluation.evaluate import PAPER_DIRECTION_DEG, PAPER_MAGNITUDE_GF
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.monte_carlo.statistics import SIGNIFICANT_STANDARD_ERRORS, MeanDifference, MeanStd
from footsense.lab.plots import plot_band, subplot_row
from footsense.lab.training.load_cases import paper_training, paper_verification
from footsense.lab.training.paper.mlp import random_layers
from footsense.lab.training.paper.procedure import EPOCHS, QUICK_EPOCHS, PaperTraining, verification_cases

#: Neurons of each hidden layer.
NEURONS, QUICK_NEURONS = (3, 5, 8, 12, 18, 27, 40), (3, 12, 40)
#: Networks of each size, which differ in their start weights.
SEEDS, QUICK_SEEDS = 20, 3
#: The magnitudes of the training cases [gf].
TRAINING_GF = (50.0, 150.0)

_DEPTH_LABELS = {"1": "one hidden layer", "2": "two hidden layers"}
#: Mean errors of each network: name, words, the paper's figure.
EVALUATED_ERRORS = (
    ("direction_error_deg", "direction, 100 gf [deg]", PAPER_DIRECTION_DEG),
    ("magnitude_error_gf", "magnitude, 100 gf [gf]", PAPER_MAGNITUDE_GF),
    ("direction_error_at_50_and_150_gf_deg", "direction, 50 and 150 gf [deg]", None),
)

#: Statistics over the seeds, for each number of neurons, by hidden layers.
ByDepth = dict[str, list[MeanStd]]


@dataclass(frozen=True, kw_only=True)
class Results:
    """Direction [deg] and magnitude [gf] errors of networks by number of hidden layers and neurons.

    Attributes:
        epochs: Training epochs.
        seeds: Networks of each size.
        neurons: Neurons of each hidden layer.
        direction_error_deg: Direction errors at 100 gf [deg].
        magnitude_error_gf: Magnitude errors at 100 gf [gf].
        direction_error_at_50_and_150_gf_deg: Direction errors at the magnitudes of the training cases [deg].
    """

    epochs: int
    seeds: int
    neurons: tuple[int, ...]
    direction_error_deg: ByDepth
    magnitude_error_gf: ByDepth
    direction_error_at_50_and_150_gf_deg: ByDepth


def n_weights(depth: int, neurons: int) -> int:
    """Return the number of weights of a network.

    Example:
        >>> n_weights(1, 18), n_weights(2, 18)
        (237, 579)
    """
    widths = np.array([9, *[neurons] * depth, 3])
    return int(((widths[:-1] + 1) * widths[1:]).sum())


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the errors of networks of every size; those of one depth train in one program, padded to the largest."""
    response = context.response
    neurons, seeds = (QUICK_NEURONS, QUICK_SEEDS) if context.quick else (NEURONS, SEEDS)
    epochs = QUICK_EPOCHS if context.quick else EPOCHS
    training = PaperTraining(response.design, paper_training(response))
    paper, *others = [paper_verification(response), *(verification_cases(response, m) for m in TRAINING_GF)]
    measured: dict[str, ByDepth] = {name: {} for name, _, _ in EVALUATED_ERRORS}
    for depth, words in _DEPTH_LABELS.items():
        room = (9, *[max(neurons)] * int(depth), 3)
        starts = [
            random_layers(np.random.default_rng(seed), (9, *[n] * int(depth), 3), room)
            for n in neurons
            for seed in range(seeds)
        ]
        estimators = training.train(starts, epochs)
        at_paper = [evaluate_force_errors(paper.force_n, read(paper.closure_um)) for read in estimators]
        at_others = [
            [evaluate_force_errors(cases.force_n, read(cases.closure_um)) for cases in others]
            for read in estimators
        ]
        figures = (
            [row.direction_deg for row in at_paper],
            [row.magnitude_gf for row in at_paper],
            [float(np.mean([row.direction_deg for row in rows])) for rows in at_others],
        )
        for (name, _, _), values in zip(EVALUATED_ERRORS, figures, strict=True):
            measured[name][depth] = [
                MeanStd.of_values(values[k : k + seeds]) for k in range(0, len(values), seeds)
            ]
        context.report_progress(
            f"hidden-layers: {len(neurons)} sizes with {words} trained, {seeds} seeds each"
        )
    results = Results(epochs=epochs, seeds=seeds, neurons=neurons, **measured)
    return results, {"hidden-layers.png": _figure(results)}


def _figure(results: Results) -> Figure:
    """Return the figure of each error over the number of neurons, with standard deviation bands."""
    figure, axes = subplot_row(len(EVALUATED_ERRORS), 8.2, 3.4)
    for panel, (name, words, paper) in zip(axes, EVALUATED_ERRORS, strict=True):
        for depth, label in _DEPTH_LABELS.items():
            plot_band(panel, results.neurons, getattr(results, name)[depth], label=label)
        if paper is not None:
            panel.axhline(paper, color="k", ls=":", label="the paper")
        panel.set(xscale="log", xlabel="neurons in each hidden layer")
        panel.set_title(words, fontsize=10)
        panel.set_xticks(results.neurons, [str(n) for n in results.neurons])
        panel.minorticks_off()
        panel.set_ylim(bottom=0.0)
    axes[0].set_ylabel("mean error")
    axes[1].legend(fontsize=8)
    return figure


def mean_error_differences_by_claim(
    neurons: Sequence[int], errors_by_depth: list[ByDepth]
) -> dict[str, list[MeanDifference]]:
    """Return differences of mean errors by comparison, one per kind of error; positive where the paper is right."""
    mean_differences: dict[str, list[MeanDifference]] = defaultdict(list)
    for by_depth in errors_by_depth:
        best = {depth: min(sizes, key=lambda one: one.mean) for depth, sizes in by_depth.items()}
        mean_differences["one layer at its best, less two at theirs"].append(
            best["1"].difference_from(best["2"])
        )
        for depth, name in _DEPTH_LABELS.items():
            for k, words in ((0, "fewest"), (-1, "most")):
                label = f"{name}: {words} neurons ({neurons[k]}), less the best"
                mean_differences[label].append(by_depth[depth][k].difference_from(best[depth]))
    return mean_differences


STUDY = Study(
    name="hidden-layers",
    title="How many hidden layers and neurons",
    compute=compute,
    template_names={"SIGNIFICANT_STANDARD_ERRORS": SIGNIFICANT_STANDARD_ERRORS},
    uses_network=False,
)
