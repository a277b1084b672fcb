"""Figure of the study `experiment`: errors over the number of calibration loads."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from footsense.lab.plots import subplot_row
from footsense.validation.virtual_experiment import CALIBRATION_LOAD_COUNTS, N_ALL_LOADS, FootResult

#: The paper's errors on its fabricated foot.
_ERROR_PANELS = (
    ("direction_vs_reference_deg", "direction error [deg]", 15.9),
    ("magnitude_vs_reference_gf", "magnitude error [gf]", 18.7),
)


def errors_over_n_loads_figure(feet: Sequence[FootResult]) -> Figure:
    """Return the figure of errors over the number of calibration loads: one line per foot, and the mean."""
    figure, row = subplot_row(2, 10.0, 4.2)
    for axes, (error, label, paper) in zip(row, _ERROR_PANELS, strict=True):
        _draw_error_panel(axes, feet, error, paper)
        axes.set_ylabel(label)
    return figure


def _draw_error_panel(axes: Axes, feet: Sequence[FootResult], error: str, paper: float) -> None:
    """Draw one kind of error; other estimators and the paper as horizontal lines."""
    counts = (*CALIBRATION_LOAD_COUNTS, N_ALL_LOADS)
    names = [f"calibrated_{n}" for n in counts]
    lines = np.array(
        [
            [
                getattr(one.errors_by_estimator[name], error) if name in one.errors_by_estimator else np.nan
                for name in names
            ]
            for one in feet
        ]
    )
    axes.plot(counts, lines.T, color="0.75", linewidth=0.7)
    known = ~np.isnan(lines).all(axis=0)
    mean = np.nanmean(lines[:, known], axis=0)
    axes.plot(np.array(counts)[known], mean, "o-", color="tab:blue", label="calibrated")
    for name, color, label in (
        ("design_only", "tab:red", "design alone"),
        ("linear_per_foot", "tab:green", "linear, own loads"),
        ("network_per_foot", "tab:orange", "network, own loads"),
    ):
        values = [
            getattr(one.errors_by_estimator[name], error) for one in feet if name in one.errors_by_estimator
        ]
        if values:
            axes.axhline(float(np.mean(values)), color=color, linestyle="--", linewidth=1.0, label=label)
    axes.axhline(paper, color="k", linestyle=":", linewidth=1.0, label="the paper, made")
    axes.set(xscale="log", yscale="log", xlabel="loads", xticks=counts)
    axes.set_xticks([], minor=True)
    axes.set_xticklabels([str(n) for n in counts])
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend(fontsize=8)
