"""Study `pattern`: the change of the nine capacitances under one inclined load, by the cheap models of the foot.

Source:
    Aoyagi et al., Fig. 17.
"""

from dataclasses import dataclass

import numpy as np

from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.lab.fidelity.drawing import pattern_tiles
from footsense.lab.fidelity.levels import NAMES, rung
from footsense.lab.studies.page import Figures, Study, StudyContext, table

_FIGURE = "pattern.png"
#: The load of Fig. 17: (theta1, theta2) [deg]. Its magnitude is not given; this is the one of the verification [gf].
_DIRECTION_DEG, _MAGNITUDE_GF = (0.0, 45.0), 100.0


@dataclass(frozen=True, kw_only=True)
class Results:
    """Changes of capacitance.

    Attributes:
        unloaded_pf: Capacitance of an unloaded element [pF].
        change_pf: Rows of the array [pF], by model.
    """

    unloaded_pf: float
    change_pf: dict[str, list[list[float]]]


def compute(context: StudyContext) -> tuple[Results, Figures]:
    """Load the foot by three models."""
    normal = directions(*np.array(_DIRECTION_DEG)[:, None])
    unloaded_pf, change_pf = context.response.design.unloaded_pf, {}
    for name in NAMES[:3]:
        answer = rung(name, context.response, context.sole).answer(
            normal, _MAGNITUDE_GF * GRAM_FORCE_N * normal
        )
        change_pf[name] = (answer.capacitance_pf[0] - unloaded_pf).reshape(3, 3)
    results = Results(
        unloaded_pf=unloaded_pf, change_pf={name: change.tolist() for name, change in change_pf.items()}
    )
    return results, {_FIGURE: pattern_tiles(change_pf)}


def render(results: Results) -> str:
    """Return the page's text."""
    rows = []
    for name, change_pf in results.change_pf.items():
        change = np.array(change_pf)
        numbers = [*change.mean(axis=1), change.max()]
        rows.append([name, *(f"{value:.3f}" for value in numbers), f"{change.max() / change.min():.2f}"])
    header = ["mean ΔC [pF]", "front row", "middle row", "rear row", "largest [pF]", "largest over smallest"]
    left, middle, right = results.change_pf["contact"][2]
    t1_deg, t2_deg = _DIRECTION_DEG
    element_pf = results.unloaded_pf
    return f"""
How do the nine capacitances change under one load at (θ1, θ2) = ({t1_deg:g}, {t2_deg:g}) deg, the case that the paper
measures and simulates in its Fig. 17? The paper draws the figure, normalised to the largest, and says that measurement
and simulation resemble each other; its text gives no numbers and no magnitude, so there is nothing to compare by
number. Here {_MAGNITUDE_GF:g} gf; unloaded, an element has {element_pf:.3f} pF. Seen from the leg. The page of the
fidelity levels has the answer of the full solve to the same load.

![]({_FIGURE})

{table(header, rows)}

The force leans forward, so the ground touches the ball at the rear, and presses the middle of the rear row first
({2.0 * middle / (left + right):.2f} times the mean of its neighbours by `contact`). The front row changes more all the
same: the force goes through the middle of the ball, so the sheet, which alone joins the two halves, carries hardly any
moment, and the front has to balance the rear.
"""


STUDY = Study(name="pattern", title="The pattern of Fig. 17", results=Results, compute=compute, render=render)
