"""Page `outlook`: what the paper leaves open, computed: loads off centre, a second load, sealed air, a film of gel.

Source:
    Aoyagi et al., end of section III A (loads), section IV ("each sealed concave space"), section VI (gel).
"""

from collections.abc import Sequence

import numpy as np

from footsense.lab.evaluation import film_against_gaps, off_centre
from footsense.lab.evaluation.evaluate_models import (
    MEASURED_DIRECTION_DEG,
    MEASURED_MAGNITUDE_GF,
    elastance_based_force_estimator,
)
from footsense.lab.evaluation.off_centre import leaning_load_errors, second_load_errors
from footsense.lab.evaluation.sealed_cavities import MAX_SEARCHED_N, sealed_against_vented
from footsense.lab.report import StudyContext, Values, spread
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


ESTIMATORS = (_NETWORK, _CENTRED)
#: Number of loads, and of each estimator mean / 95 % / worst direction and mean magnitude error.
ERROR_CELLS = " | ".join(
    [
        f"{{errors[{_NETWORK}][n]}}",
        *(
            f"{{errors[{name}][direction_deg]:.2f}} / {{errors[{name}][direction_p95_deg]:.2f}}"
            f" / {{errors[{name}][direction_max_deg]:.2f}}, {{errors[{name}][magnitude_gf]:.1f}}"
            for name in ESTIMATORS
        ),
    ]
)


def _deg_and_gf(pairs: Sequence[Sequence[float]]) -> tuple[str, str]:
    deg, gf = zip(*pairs, strict=True)
    return spread(deg), spread(gf)


def _up_to(force_n: float) -> str:
    return f"{force_n:.1f}" if force_n < MAX_SEARCHED_N else f"above {MAX_SEARCHED_N:.0f}"


def _beside(*columns: dict[str, str]) -> list[tuple[str, ...]]:
    """Return the rows of the same figures of several feet side by side."""
    return [(name, *(cells[name] for cells in columns)) for name in columns[0]]


def _air_cells(kind: Values) -> dict[str, str]:
    """Return the figures of sealed or vented cavities."""
    cells = {
        "range of the converter, upright [N]": _up_to(kind["range_n"]),
        "first cell closed at, upright [N]": _up_to(kind["closing_n"]),
    }
    for name, errors in zip(("change of capacitance", "elastance"), kind["linear"], strict=True):
        cells[f"designed foot, linear in {name} [deg / gf]"] = " / ".join(f"{one:.2f}" for one in errors)
    for key, name in (
        ("exact", "designed foot, paper's procedure"),
        ("made", "made feet, paper's procedure on each"),
    ):
        cells[f"{name} [deg]"], cells[f"{name} [gf]"] = _deg_and_gf(kind[key])
    return cells


def _film_cells(one: Values) -> dict[str, str]:
    """Return the figures of the film or of the gaps."""
    (upright_n, inclined_n), (deg, gf), networks = one["range_n"], one["linear"], _deg_and_gf(one["networks"])
    return {
        "unloaded capacitance [pF]": f"{one['unloaded_pf']:.2f}",
        "mean closure, upright [um/N]": f"{one['um_per_n']:.2f}",
        "sensitivity, upright [pF/N]": f"{one['pf_per_n']:.2f}",
        "range, upright / elevation 45 deg [N]": f"{upright_n:.1f} / {inclined_n:.1f}",
        "linear read-out [deg / gf]": f"{deg:.2f} / {gf:.2f}",
        "networks [deg]": networks[0],
        "networks [gf]": networks[1],
    }


def shown(values: Values) -> Values:
    """Return the rows of air and film, means of the errors with sealed air, and where constants are."""
    air, film = values["air"], values["film"]["designs"]
    return {
        "air_rows": _beside(_air_cells(air["vented"]), _air_cells(air["sealed"])),
        "film_rows": _beside(_film_cells(film["gaps"]), _film_cells(film["film"])),
        "sealed": {key: np.mean(air["sealed"][key], axis=0).tolist() for key in ("exact", "made")},
        "worst": np.max(air["sealed"]["made"], axis=0).tolist(),
        "lever_mm": values["ball_radius_mm"] * np.sin(np.radians(values["lean"][1]["x"])),
        "measured": (MEASURED_DIRECTION_DEG, MEASURED_MAGNITUDE_GF),
        "off": off_centre,
        "gel": film_against_gaps,
        "noise_ff": 1e3 * NOISE_PF,
        "full_scale_pf": FULL_SCALE_PF,
        "searched_n": MAX_SEARCHED_N,
        "hidden": HIDDEN_NEURONS,
    }
