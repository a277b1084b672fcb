"""Page `outlook`: what the paper leaves open, computed: loads off centre, a second load, sealed air, a film of gel.

Source:
    Aoyagi et al., end of section III A (loads), section IV ("each sealed concave space"), section VI (gel).
"""

import numpy as np

from footsense.lab.evaluation import film_against_gaps, off_centre
from footsense.lab.evaluation.evaluate_models import (
    MEASURED_DIRECTION_DEG,
    MEASURED_MAGNITUDE_GF,
    elastance_based_force_estimator,
)
from footsense.lab.evaluation.off_centre import leaning_load_errors, second_load_errors
from footsense.lab.evaluation.sealed_cavities import MAX_SEARCHED_N, sealed_against_vented
from footsense.lab.report import StudyContext, Values
from footsense.lab.training.load_cases import FULL_SCALE_PF, NOISE_PF, paper_training
from footsense.lab.training.paper_procedure import HIDDEN_NEURONS

TITLE = "What the paper leaves open"

_NETWORK, _CENTRED = "released network", "linear, centred loads"
#: Starts of the networks, and made feet; epochs of the paper's procedure.
_N, _QUICK_N, _EPOCHS, _QUICK_EPOCHS = 10, 2, 3000, 200


def compute(context: StudyContext) -> Values:
    """Read loads off centre and beside a second one, then compare sealed with vented cavities, and a film with gaps."""
    design, response, quick = context.foot_design, context.response, context.quick
    network, gap_um = context.network, response.design.gap_um
    estimators = {
        _NETWORK: lambda closure_um: network.force_n(closure_um / gap_um),
        _CENTRED: elastance_based_force_estimator(paper_training(response)),
    }
    lean = leaning_load_errors(response, estimators)
    second = second_load_errors(response, estimators, 1 if quick else 6)
    context.report_progress("leaning and second loads read")
    n, epochs = (_QUICK_N, _QUICK_EPOCHS) if quick else (_N, _EPOCHS)
    air = sealed_against_vented(response, n, epochs)
    context.report_progress("sealed air done")
    return {
        "n": n,
        "epochs": epochs,
        "lean": lean,
        "trained_lean_deg": design.loads.friction_angle_deg,
        "second": second,
        "ball_radius_mm": design.ball_radius_mm,
        "air": air,
        "film": film_against_gaps.film_against_gaps(design, response, n, epochs, quick=quick),
    }


def shown(values: Values) -> Values:
    """Return how far the line of a leaning force passes beside the middle, and where constants are."""
    return {
        "lever_mm": values["ball_radius_mm"] * np.sin(np.radians(values["lean"][1]["x"])),
        "measured": (MEASURED_DIRECTION_DEG, MEASURED_MAGNITUDE_GF),
        "off": off_centre,
        "gel": film_against_gaps,
        "noise_ff": 1e3 * NOISE_PF,
        "full_scale_pf": FULL_SCALE_PF,
        "searched_n": MAX_SEARCHED_N,
        "hidden": HIDDEN_NEURONS,
    }
