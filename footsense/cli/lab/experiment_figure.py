"""The figure of the experiment: errors over the number of loads that a foot was calibrated with."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from footsense.validation.virtual_experiment import ALL, FEW, FootResult

_PANELS = (("direction_deg", "direction error [deg]", 15.9), ("magnitude_gf", "magnitude error [gf]", 18.7))


def few_shot(judged: Sequence[FootResult]) -> Figure:
    """Return the figure: each foot a line, their mean a thicker one, the paper's figure and other ways beside."""
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    for axes, (what, label, paper) in zip(figure.subplots(1, 2), _PANELS, strict=True):
        _panel(axes, judged, what, paper)
        axes.set_ylabel(label)
    return figure


def _panel(axes: Axes, judged: Sequence[FootResult], what: str, paper: float) -> None:
    counts = (*FEW, ALL)
    lines = np.array(
        [
            [
                getattr(one.errors[way], what) if (way := f"calibrated_{n}") in one.errors else np.nan
                for n in counts
            ]
            for one in judged
        ]
    )
    axes.plot(counts, lines.T, color="0.75", linewidth=0.7)
    known = ~np.isnan(lines).all(axis=0)
    axes.plot(
        np.array(counts)[known],
        np.nanmean(lines[:, known], axis=0),
        "o-",
        color="tab:blue",
        label="calibrated",
    )
    others = (
        ("design_only", "tab:red", "design alone"),
        ("linear_per_foot", "tab:green", "linear, own loads"),
    )
    for way, color, name in (*others, ("network_per_foot", "tab:orange", "network, own loads")):
        values = [getattr(one.errors[way], what) for one in judged if way in one.errors]
        if values:
            axes.axhline(float(np.mean(values)), color=color, linestyle="--", linewidth=1.0, label=name)
    axes.axhline(paper, color="k", linestyle=":", linewidth=1.0, label="the paper, made")
    axes.set(xscale="log", yscale="log", xlabel="loads", xticks=counts)
    axes.set_xticks([], minor=True)
    axes.set_xticklabels([str(n) for n in counts])
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend(fontsize=8)
