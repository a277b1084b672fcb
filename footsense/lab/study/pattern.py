"""The paper's Fig. 17: what one inclined load does to the nine capacitances, by each model of the foot."""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.lab.dataset import GRAM_FORCE_N, directions
from footsense.lab.geometry import SoleDesign
from footsense.lab.ladder.rungs import NAMES, rung
from footsense.lab.study.page import Page, Workbench, table

_FIGURE = "pattern.png"
#: The load of Fig. 17: (theta1, theta2) [deg]. Its magnitude is not given; this is the one of the verification [gf].
_DIRECTION_DEG, _MAGNITUDE_GF = (0.0, 45.0), 100.0


def _figure(change_pf: dict[str, NDArray[np.float64]]) -> Figure:
    """Return a grid of tiles per model: colour and upper number over the largest of the nine, lower number in pF."""
    figure = Figure(figsize=(2.75 * len(change_pf) + 0.8, 3.2), layout="constrained")
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


def page(bench: Workbench) -> Page:
    """Return the page."""
    names = NAMES[:3] if bench.quick else NAMES
    normal = directions(*np.array(_DIRECTION_DEG)[:, None])
    force_n = _MAGNITUDE_GF * GRAM_FORCE_N * normal
    design = bench.response.design
    change_pf = {}
    for name in names:
        answer = rung(name, bench.response, SoleDesign()).answer(normal, force_n)
        change_pf[name] = (answer.capacitance_pf[0] - design.rest_pf).reshape(3, 3)
        bench.say(f"pattern: {name} has answered")
    rows = []
    for name, change in change_pf.items():
        numbers = [*change.mean(axis=1), change.max()]
        rows.append([name, *(f"{value:.3f}" for value in numbers), f"{change.max() / change.min():.2f}"])
    header = ["mean ΔC [pF]", "front row", "middle row", "rear row", "largest [pF]", "largest over smallest"]
    side = {name: float(change[2, 1] / change[2, [0, 2]].mean()) for name, change in change_pf.items()}
    finest = names[-1]
    t1_deg, t2_deg = _DIRECTION_DEG
    body = f"""
{"**Quick run: without the full solve.**" if bench.quick else ""}

What do the nine capacitances do under one load at (θ1, θ2) = ({t1_deg:g}, {t2_deg:g}) deg, the case that the paper
measures and simulates in its Fig. 17? The paper draws the figure, normalised to the largest, and says that measurement
and simulation resemble each other; its text gives no numbers and no magnitude, so there is nothing to compare by
number. Here {_MAGNITUDE_GF:g} gf; unloaded, an element has {design.rest_pf:.3f} pF. Seen from the leg.

![]({_FIGURE})

{table(header, rows)}

The force leans forward, so the ground touches the ball at the rear, and what it presses first is the middle of the rear
row ({side[finest]:.2f} times the mean of its neighbours by `{finest}`). The front row changes more all the same: the
force goes through the middle of the ball, so the sheet, which alone joins the two halves, carries hardly any moment,
and what the rear carries the front has to balance.
"""
    return Page(
        name="pattern",
        title="The pattern of Fig. 17",
        body=body,
        figures={_FIGURE: _figure(change_pf)},
        values={
            "quick": bench.quick,
            "direction_deg": list(_DIRECTION_DEG),
            "magnitude_gf": _MAGNITUDE_GF,
            "change_pf": {name: change.tolist() for name, change in change_pf.items()},
        },
    )
