"""Figures of the fidelity levels: error over computing time, and maps of the capacitance changes."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from footsense.frames import Vector
from footsense.lab.fidelity.compare import FidelityError
from footsense.lab.fidelity.forward import ForwardAgainstTable


def error_over_time_figure(
    seconds: dict[str, float],
    distances: dict[str, FidelityError],
    finest: str,
    forward: ForwardAgainstTable,
    n: int,
) -> Figure:
    """Return the figure of error over computing time; the finest level, the reference, as a line.

    Args:
        seconds: Time of a load [s], by level.
        distances: Differences from the finest, by level.
        finest: Name of the finest.
        forward: One solve per load, drawn at the error of `linear`.
        n: Loads of the time axis.
    """
    figure = Figure(figsize=(8.2, 4.4), layout="constrained")
    axes = figure.subplots()
    for place, (name, apart) in enumerate(distances.items()):
        at = (seconds[name] * n, 100.0 * apart.closure_difference_rms_rel)
        axes.plot(*at, "o", color=f"C{place}", ms=9)
        axes.annotate(name, at, xytext=(0, 9), textcoords="offset points", ha="center")
    at = (forward.forward_solve_s_per_load * n, 100.0 * distances["linear"].closure_difference_rms_rel)
    axes.plot(*at, "D", color="0.5", ms=8)
    axes.annotate("linear, one solve per load", at, xytext=(0, 9), textcoords="offset points", ha="right")
    axes.axvline(seconds[finest] * n, color="k", ls="--")
    axes.annotate(
        f"{finest}: counted from",
        (seconds[finest] * n, 0.97),
        xycoords=("data", "axes fraction"),
        xytext=(-5, 0),
        textcoords="offset points",
        rotation=90,
        ha="right",
        va="top",
    )
    axes.set(xscale="log", yscale="log", xlabel=f"time for the {n} load cases of the paper [s]")
    axes.set_ylabel(f"closures: rms difference from {finest} [%]")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.margins(x=0.15, y=0.2)
    axes.grid(alpha=0.3)
    return figure


def capacitance_pattern_figure(change_pf: dict[str, Vector]) -> Figure:
    """Return a figure of capacitance changes, 3 x 3 tiles per model: number relative to the largest, and in pF.

    Args:
        change_pf: Change of each capacitance [pF] by model, shape (3, 3), at least one of them above 0.
    """
    figure = Figure(figsize=(2.1 * len(change_pf) + 0.9, 2.7), layout="constrained")
    row = np.atleast_1d(figure.subplots(1, len(change_pf)))
    for axes, (name, change) in zip(row, change_pf.items(), strict=True):
        normalised = change / change.max()
        tiles = axes.imshow(normalised, cmap="viridis", vmin=0.0, vmax=1.0)
        for (i, j), value in np.ndenumerate(normalised):
            ink = "k" if value > 0.6 else "w"
            axes.text(j, i, f"{value:.2f}", ha="center", va="bottom", color=ink, fontsize=12)
            axes.text(j, i + 0.06, f"{change[i, j]:.3f} pF", ha="center", va="top", color=ink, fontsize=8)
        axes.set_xticks([0, 1, 2], ["left", "", "right"])
        axes.set_yticks([0, 1, 2], ["front", "", "rear"] if axes is row[0] else [])
        axes.tick_params(length=0)
        axes.set_title(name)
    figure.colorbar(tiles, ax=list(row), label="ΔC over the largest of the nine", shrink=0.85)
    return figure
