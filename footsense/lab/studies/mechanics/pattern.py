"""The paper's Fig. 17: what one inclined load does to the nine capacitances, by the cheap models of the foot."""

import numpy as np

from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.lab.fidelity.drawing import pattern_tiles
from footsense.lab.fidelity.levels import NAMES, rung
from footsense.lab.studies.page import Page, StudyContext, table

_FIGURE = "pattern.png"
#: The load of Fig. 17: (theta1, theta2) [deg]. Its magnitude is not given; this is the one of the verification [gf].
_DIRECTION_DEG, _MAGNITUDE_GF = (0.0, 45.0), 100.0


def page(bench: StudyContext) -> Page:
    """Return the page."""
    normal = directions(*np.array(_DIRECTION_DEG)[:, None])
    force_n = _MAGNITUDE_GF * GRAM_FORCE_N * normal
    design = bench.response.design
    change_pf = {}
    for name in NAMES[:3]:
        answer = rung(name, bench.response, bench.sole).answer(normal, force_n)
        change_pf[name] = (answer.capacitance_pf[0] - design.rest_pf).reshape(3, 3)
        bench.say(f"pattern: {name} has answered")
    rows = []
    for name, change in change_pf.items():
        numbers = [*change.mean(axis=1), change.max()]
        rows.append([name, *(f"{value:.3f}" for value in numbers), f"{change.max() / change.min():.2f}"])
    header = ["mean ΔC [pF]", "front row", "middle row", "rear row", "largest [pF]", "largest over smallest"]
    rear = change_pf["contact"][2]
    beside = rear[1] / rear[[0, 2]].mean()
    t1_deg, t2_deg = _DIRECTION_DEG
    body = f"""
What do the nine capacitances do under one load at (θ1, θ2) = ({t1_deg:g}, {t2_deg:g}) deg, the case that the paper
measures and simulates in its Fig. 17? The paper draws the figure, normalised to the largest, and says that measurement
and simulation resemble each other; its text gives no numbers and no magnitude, so there is nothing to compare by
number. Here {_MAGNITUDE_GF:g} gf; unloaded, an element has {design.rest_pf:.3f} pF. Seen from the leg. What
the full solve says to the same load is on the page of the ladder.

![]({_FIGURE})

{table(header, rows)}

The force leans forward, so the ground touches the ball at the rear, and what it presses first is the middle of the rear
row ({beside:.2f} times the mean of its neighbours by `contact`). The front row changes more all the same: the
force goes through the middle of the ball, so the sheet, which alone joins the two halves, carries hardly any moment,
and what the rear carries the front has to balance.
"""
    return Page(
        name="pattern",
        title="The pattern of Fig. 17",
        body=body,
        figures={_FIGURE: pattern_tiles(change_pf)},
        values={
            "direction_deg": list(_DIRECTION_DEG),
            "magnitude_gf": _MAGNITUDE_GF,
            "change_pf": {name: change.tolist() for name, change in change_pf.items()},
        },
    )
