"""What air that is sealed in does to a foot at rest: closures, range, and the errors of the paper's procedure.

Source:
    Aoyagi et al., section IV: "each sealed concave space".
"""

from bisect import bisect_left
from collections.abc import Callable
from typing import Any

import numpy as np

from footsense.foot.directions import normalized
from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate_models import (
    capacitance_based_force_estimator,
    elastance_based_force_estimator,
)
from footsense.lab.fem.sealed_air import SealedFoot
from footsense.lab.training.load_cases import (
    FULL_SCALE_PF,
    Cases,
    closure_of_designed_foot_um,
)
from footsense.lab.training.paper_procedure import Layers, PaperTraining, start_weights_by_seed
from footsense.sim.fabrication import PAPER_TOLERANCES, draw_deviations
from footsense.sim.loads.press_sequence import paper_presses

UPWARD = np.array([[0.0, 0.0, 1.0]])
#: Largest load of the searches for a range, and that of a sensitivity, at which no gap closes [N].
MAX_SEARCHED_N, SMALL_N = 40.0, 0.05
_SEARCHED_N = np.geomspace(SMALL_N, MAX_SEARCHED_N, 200)


def largest_force_n(used_rel: Callable[[Vector, Vector], float], direction: Vector = UPWARD) -> float:
    """Return the largest of `_SEARCHED_N` of which a centred load uses less than all [N]; a larger one never does."""
    first_beyond = bisect_left(
        _SEARCHED_N.tolist(), 1.0, lo=1, key=lambda size_n: used_rel(direction, size_n * direction)
    )
    return float(_SEARCHED_N[first_beyond - 1])


def mean_errors(cases: Cases, force_n: Vector) -> tuple[float, float]:
    """Return mean direction [deg] and magnitude error [gf]."""
    errors = evaluate_force_errors(cases.force_n, force_n)
    return errors.direction_deg, errors.magnitude_gf


def sealed_against_vented(response: FootResponse, n: int, epochs: int) -> dict[str, Any]:
    """Return the figures of vented and of sealed cavities at rest, by name.

    Args:
        response: The designed foot's table.
        n: Start weights of each network, and made feet.
        epochs: Of the networks' training.
    """
    design, starts = response.design, start_weights_by_seed(n)
    kinds: dict[str, type[Specimen]] = {"vented": Specimen, "sealed": SealedFoot}
    cases = {name: _paper_cases(kind(response)) for name, kind in kinds.items()}
    networks = {
        name: PaperTraining(design, training).train(starts, epochs) for name, (training, _) in cases.items()
    }
    by_kind = {}
    for name, kind in kinds.items():
        training, test = cases[name]
        linear = (
            capacitance_based_force_estimator(design, training),
            elastance_based_force_estimator(training),
        )
        by_kind[name] = {
            **_reach(kind(response)),
            "linear": [mean_errors(test, read(test.closure_um)) for read in linear],
            "exact": [mean_errors(test, read(test.closure_um)) for read in networks[name]],
            "made": [
                _made_foot_errors(kind, response, number, starts[number], epochs) for number in range(n)
            ],
        }
    return by_kind


def _paper_cases(foot: Specimen) -> tuple[Cases, Cases]:
    """Return the paper's 362 and 180 loads on a foot, with the closures that its changes of capacitance stand for."""
    training, test = (
        Cases(
            one,
            closure_of_designed_foot_um(
                foot.response.design, foot.capacitance_pf(normalized(one), one) - foot.unloaded_pf
            ),
        )
        for one in (paper_presses("training"), paper_presses("verification"))
    )
    return training, test


def _made_foot_errors(
    kind: type[Specimen], response: FootResponse, number: int, start: Layers, epochs: int
) -> tuple[float, float]:
    """Return the errors of the paper's procedure on a made foot, whose readings and references are exact."""
    training, test = _paper_cases(kind(response, draw_deviations(response, PAPER_TOLERANCES, 0, number)))
    (read,) = PaperTraining(response.design, training).train([start], epochs)
    return mean_errors(test, read(test.closure_um))


def _reach(foot: Specimen) -> dict[str, Any]:
    """Return the upright ranges of a designed foot."""

    def used_full_scale(normal: Vector, force_n: Vector) -> float:
        return float(foot.capacitance_pf(normal, force_n).max() / FULL_SCALE_PF)

    def used_gap(normal: Vector, force_n: Vector) -> float:
        return float(foot.cell_closures_um(normal, force_n).max() / foot.response.design.gap_um)

    return {"range_n": largest_force_n(used_full_scale), "closing_n": largest_force_n(used_gap)}
