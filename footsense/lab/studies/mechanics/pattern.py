"""Study `pattern`: change of the nine capacitances under one inclined load, by the linear models of the foot.

Source:
    Aoyagi et al., Fig. 17.
"""

from dataclasses import dataclass

import numpy as np

from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.lab.fidelity.drawing import capacitance_pattern_figure
from footsense.lab.fidelity.levels import LEVEL_NAMES, fidelity_level
from footsense.lab.former_page import Plots, Study, StudyContext

#: The load of Fig. 17: (theta1, theta2) [deg]. Its magnitude is not given; this is the one of the verification [gf].
DIRECTION_DEG, MAGNITUDE_GF = (0.0, 45.0), 100.0


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `pattern`: capacitance changes of the nine elements [pF], by model.

    Attributes:
        unloaded_pf: Capacitance of an unloaded element [pF].
        change_pf: Rows of the array [pF], by model.
    """

    unloaded_pf: float
    change_pf: dict[str, list[list[float]]]


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the capacitance changes under one inclined load by three models of the foot, with a figure."""
    normal = directions(*np.array(DIRECTION_DEG)[:, None])
    unloaded_pf, change_pf = context.response.design.unloaded_pf, {}
    for name in LEVEL_NAMES[:3]:
        level = fidelity_level(name, context.response, context.foot_design)
        answer = level(normal, MAGNITUDE_GF * GRAM_FORCE_N * normal)
        change_pf[name] = (answer.capacitance_pf[0] - unloaded_pf).reshape(3, 3)
    results = Results(
        unloaded_pf=unloaded_pf, change_pf={name: change.tolist() for name, change in change_pf.items()}
    )
    return results, {"pattern.png": capacitance_pattern_figure(change_pf)}


STUDY = Study(name="pattern", title="The pattern of Fig. 17", compute=compute, uses_network=False)
