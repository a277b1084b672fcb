"""Page `experiment`: made feet. Causes of the paper's error, calibrations, and feet that these do not know."""

from collections.abc import Iterable
from dataclasses import asdict, replace
from functools import lru_cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from footsense.calibration.calibrate import (
    MAX_MEDIAN_MAHALANOBIS_DISTANCE,
    WARNING_MEDIAN_MAHALANOBIS_DISTANCE,
)
from footsense.calibration.evaluation import DesignModels
from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads, Specimen
from footsense.lab.evaluation.evaluate_models import (
    MEASURED_DIRECTION_DEG,
    MEASURED_MAGNITUDE_GF,
    RESPONSE_FILE,
)
from footsense.lab.evaluation.off_table import OffTableFoot
from footsense.lab.fem.sealed_air import SealedFoot
from footsense.lab.fem.whole import other_tables
from footsense.lab.foot_file import FOOT_FILE
from footsense.lab.parallel import N_PROCESSES, compute_each
from footsense.lab.report import SAME_TABLE, StudyContext, Values, spread
from footsense.lab.studies.boards.made_feet import sigma_of_made_foot, sigma_rows
from footsense.lab.training.load_cases import leaning_loads
from footsense.lab.training.paper_procedure import EPOCHS, per_foot_force_n
from footsense.lab.walkers.gaits import GAITS_FILE
from footsense.sim.fabrication import PAPER_TOLERANCES, SESSION_GAIN_REL, FootTolerances, draw_deviations
from footsense.sim.loads.press_sequence import paper_presses
from footsense.sim.rubber import RUBBER_LEVELS
from footsense.validation.made_feet import (
    EXACT_CONDITIONS,
    SEED,
    FootModel,
    MadeFootPlan,
    PressConditions,
    PressedFoot,
    evaluate_made_foot,
)

TITLE = "Made feet: the paper's error, calibration, and what a calibration does not know"

_N_FEET, _QUICK_N_FEET, _N_SIGMA_FEET = 20, 2, 12
_QUICK_EVERY, _QUICK_EPOCHS = 9, 300
#: Loads over the whole range, their sizes, and the lowest elevation of force and normal, with a mount that is turned.
_N_RANGE, RANGE_GF, _MIN_ELEVATION_DEG = 180, (20.0, 200.0), 32.0

#: Postures of a calibration by standing, sizes of their loads, and lowest elevation [deg].
N_POSTURES, POSTURE_GF, MIN_POSTURE_ELEVATION_DEG = 20, (20.0, 120.0), 70.0

#: Rms levels of causes: none, and those of feet and test stand on which the paper's procedure errs as in the paper.
_EXACT = asdict(FootTolerances()) | asdict(EXACT_CONDITIONS)
_STAND = replace(
    EXACT_CONDITIONS, reading_noise_pf=1e-3, repeatability_rel=0.02, force_noise_steps=1.1, lean_rms_deg=2.15
)
_TUNED = asdict(PAPER_TOLERANCES) | asdict(_STAND)
#: The causes in words, and the factor to their unit.
NONE, ALL = "none", "all"
CAUSES = {
    NONE: ("none: the procedure's own error", 1.0),
    "gap_um": ("gap of each element [um]", 1.0),
    "film_um": ("film of each element [um]", 1.0),
    "stray_pf": ("stray of each element [pF]", 1.0),
    "stiffness_rel": ("stiffness of the foot [%]", 100.0),
    "mount_deg": ("mount of the foot [deg]", 1.0),
    "reading_noise_pf": ("reading [fF]", 1e3),
    "repeatability_rel": ("creep while nine elements are read one by one [% of the change]", 100.0),
    "force_noise_steps": ("reference, read once [steps of 4, 4, 12 gf]", 1.0),
    "lean_rms_deg": ("stick set by hand [deg]", 1.0),
    ALL: ("all together", 1.0),
}


class _Kind(NamedTuple):
    """Feet that differ from what the calibration supposes in one way; `table` names another response table."""

    words: str
    conditions: PressConditions = PressConditions()
    table: str = ""
    foot_model: FootModel = Specimen


SUPPOSED = "supposed"
_KINDS = {
    SUPPOSED: _Kind("none: the foot that the calibration supposes"),
    "floor_capacitance": _Kind(
        "a floor that adds 0.05 to 0.2 pF", PressConditions(max_floor_capacitance_pf=0.2)
    ),
    "rubber_insole": _Kind(
        "creep and play of a measured insole's foam",
        PressConditions(creep_factor=RUBBER_LEVELS["insole"][0], play_factor=RUBBER_LEVELS["insole"][1]),
    ),
    "gains_wander": _Kind(
        "gains that wander by 4 % after the calibration",
        PressConditions(gain_wander_rel=SESSION_GAIN_REL),
    ),
    "element_creep_strong": _Kind(
        "elements that creep differently by 3 %", PressConditions(creep_spread_rel=0.03)
    ),
    "sheet_off_centre": _Kind("sheet 0.6 mm off centre", table="sheet_off_centre"),
    "bar_not_bonded": _Kind("one bar not bonded", table="bar_not_bonded"),
    "table_far_off": _Kind("changes 1 % rms off the table", foot_model=partial(OffTableFoot, error_rel=0.01)),
    "tuned_stand": _Kind(
        "calibrated on a test stand tuned to the paper's error",
        PressConditions(force_noise_steps=_STAND.force_noise_steps, lean_rms_deg=_STAND.lean_rms_deg),
    ),
    "sealed": _Kind("cavities sealed, as the paper's", foot_model=SealedFoot),
}
#: Kinds of the quick form: their tables need no solve.
_QUICK_KINDS = (SUPPOSED, "floor_capacitance", "sealed")
_QUICKCAUSES = (NONE, "lean_rms_deg", ALL)
#: Columns of a kind, of those of `evaluate_made_foot`.
_FIGURES = ("deg", "gf", "true_deg", "true_gf", "no_force", "within_2_sigma")


def compute(context: StudyContext) -> Values:
    """Run the paper's procedure with each cause of error, then calibrate the feet of each kind."""
    n_feet, epochs = (_QUICK_N_FEET, _QUICK_EPOCHS) if context.quick else (_N_FEET, EPOCHS)
    folder = context.files(FOOT_FILE, RESPONSE_FILE, NETWORK_FILE).resolve()
    context.table_file(GAITS_FILE)
    each = partial(compute_each, n_processes=1 if context.quick else N_PROCESSES)
    causes = _QUICKCAUSES if context.quick else tuple(CAUSES)
    sets = {name: _EXACT | {one: _TUNED[one] for one in _TUNED if name in (one, ALL)} for name in causes}
    procedure = partial(_procedure_errors, folder, epochs)
    found = each(procedure, [(levels, number) for levels in sets.values() for number in range(n_feet)])
    errors = np.round(found, 4).reshape(len(sets), n_feet, 2)
    rows = [{"deg": one[:, 0], "gf": one[:, 1]} for one in errors]
    context.report_progress("causes done")
    names = _QUICK_KINDS if context.quick else tuple(_KINDS)
    solved = {} if context.quick else other_tables(context.foot_design, context.response, each)
    tables = {"": context.response} | solved
    tests = {
        "centred": ContactLoads.centred(paper_presses("verification")),
        "range": leaning_loads(context.foot_design.loads, _N_RANGE, RANGE_GF, _MIN_ELEVATION_DEG, SEED),
    }
    postures = leaning_loads(
        context.foot_design.loads, N_POSTURES, POSTURE_GF, MIN_POSTURE_ELEVATION_DEG, SEED + 1
    )
    plan = MadeFootPlan(_QUICK_EVERY if context.quick else 1, tests, postures)
    evaluate = partial(_evaluate, folder, plan, epochs)
    parts = [(name, tables[_KINDS[name].table], number) for name in names for number in range(n_feet)]
    feet = each(evaluate, parts)
    kinds = {name: _columns(feet[k * n_feet : (k + 1) * n_feet]) for k, name in enumerate(names)}
    context.report_progress("feet of all kinds done")
    sigma_of = partial(
        sigma_of_made_foot, folder, plan, context.foot_design.loads.max_n, walks=not context.quick
    )
    sigma = each(sigma_of, list(range(2 if context.quick else _N_SIGMA_FEET)))
    context.drawings["experiment.png"] = _figure(kinds)
    return {
        "n_feet": n_feet,
        "seed": SEED,
        "n_presses": len(paper_presses("training")[:: plan.every_nth_press]),
        "n_range_loads": len(plan.tests["range"].force_n),
        "epochs": epochs,
        "levels": _TUNED,
        "causes": dict(zip(sets, rows, strict=True)),
        "kinds": kinds,
        "sigma": sigma,
    }


@lru_cache(maxsize=1)
def _models(folder: Path) -> DesignModels:
    return DesignModels.load(folder)


def _procedure_errors(folder: Path, epochs: int, part: tuple[dict[str, float], int]) -> tuple[float, float]:
    """Return direction [deg] and magnitude error [gf] of the paper's procedure on one foot, against the reference."""
    (levels, number), response = part, _models(folder).response
    tolerances = FootTolerances(**{name: levels[name] for name in asdict(PAPER_TOLERANCES)})
    stand = PressConditions(**{name: levels[name] for name in asdict(EXACT_CONDITIONS)})
    own = draw_deviations(response, tolerances, SEED, number)
    foot = PressedFoot(Specimen(response, own), own.mount, stand, np.random.default_rng((SEED, number, 1)))
    training, test = (foot.press_with_stick(paper_presses(name)) for name in ("training", "verification"))
    change_pf, test_pf = (one.capacitance_pf - one.baseline_pf for one in (training, test))
    force_n = per_foot_force_n(response.design, number, epochs, change_pf, training.force_n, test_pf)
    errors = evaluate_force_errors(test.force_n, force_n)
    return errors.direction_deg, errors.magnitude_gf


def _evaluate(
    folder: Path, plan: MadeFootPlan, epochs: int, part: tuple[str, FootResponse, int]
) -> dict[str, Any]:
    """Return the figures of one foot of a kind; the paper's network only of the feet that are as supposed."""
    (name, truth, number), models = part, _models(folder)
    kind = _KINDS[name]
    network = partial(per_foot_force_n, models.response.design, number, epochs) if name == SUPPOSED else None
    return evaluate_made_foot(models, truth, kind.conditions, plan, number, kind.foot_model, network)


def _columns(feet: list[dict[str, Any]]) -> Values:
    """Return the figures of all feet of a kind as lists over the feet; None where a foot has no force at all."""
    columns: Values = {"n_loads": [foot["n_loads"] for foot in feet]}
    for estimator in feet[0]["errors"]["centred"]:
        columns[estimator] = {}
        for test in ("centred", "range"):
            errors = [foot["errors"][test][estimator] or {} for foot in feet]
            columns[estimator][test] = {name: [one.get(name) for one in errors] for name in _FIGURES}
    for name in ("few", "all", "standing"):
        judged = [foot["calibrations"][name] for foot in feet]
        columns[name] |= {key: [one[key] for one in judged] for key in judged[0]}
    return columns


def accepted(columns: Values, calibration: str) -> list[int]:
    """Return the numbers of the feet of a kind whose calibration is not refused."""
    return [number for number, refused in enumerate(columns[calibration]["refused"]) if not refused]


def worst_accepted(values: Values, test: str, figure: str) -> tuple[float, str]:
    """Return the worst foot's error and its kind, of all other kinds of feet calibrated with all loads and accepted."""
    return max(
        (columns["all"][test][figure][number], _KINDS[name].words)
        for name, columns in values["kinds"].items()
        if name != SUPPOSED
        for number in accepted(columns, "all")
    )


def shown(values: Values) -> Values:
    """Return the rows of the page's tables, and who is worst, refused in part, and refused."""
    made, kinds = values["kinds"][SUPPOSED], values["kinds"]
    figures = ("true_deg", "true_gf")
    return {
        "made": made,
        "worst_made": {one: max(made["all"]["centred"][one]) for one in figures},
        "worst_other": {one: worst_accepted(values, "centred", one)[0] for one in figures},
        "n_other_kinds": len(kinds) - 1,
        "kinds": [_kind_row(_KINDS[name], one) for name, one in kinds.items()],
        "n_pressed_loads": np.mean(made["n_loads"]),
        "left_out": {name: _percent(made[name]["centred"]["no_force"]) for name in ("design", "all")},
        "range_left_out": _percent(made["all"]["range"]["no_force"]),
        "n_soft": sum(share > 0.5 for share in made["all"]["centred"]["no_force"]),
        "refused": [_KINDS[name].words for name, one in kinds.items() if not accepted(one, "all")],
        "worst": [worst_accepted(values, "range", one) for one in figures],
        "paper_errors": (MEASURED_DIRECTION_DEG, MEASURED_MAGNITUDE_GF),
        "sigma_rows": sigma_rows(values["sigma"]),
        "warned_from": WARNING_MEDIAN_MAHALANOBIS_DISTANCE,
        "refused_from": MAX_MEDIAN_MAHALANOBIS_DISTANCE,
    }


def _kind_row(kind: _Kind, columns: Values) -> tuple[str, ...]:
    """Return the cells of a kind: how many feet pass, errors of those, and errors of its other calibrations.

    Where none passes, the errors are those that the refused feet would have.
    """
    one, passed = columns["all"], accepted(columns, "all")

    def of(calibration: str, test: str, figure: str) -> list[float | None]:
        found = columns[calibration][test][figure]
        return [found[number] for number in accepted(columns, calibration)] or found

    is_same = not kind.table and kind.foot_model is Specimen
    return (
        f"{kind.words}, {SAME_TABLE}" if is_same else kind.words,
        f"{len(passed)}, {sum(one['warned'][number] for number in passed)}",
        *(
            spread_over_feet(of("all", test, figure))
            for test in ("centred", "range")
            for figure in ("true_deg", "true_gf")
        ),
        *(_percent(of("all", "range", figure)) for figure in ("no_force", "within_2_sigma")),
        *(_worst(of(calibration, "centred", "true_deg")) for calibration in ("few", "standing")),
    )


def _worst(over_feet: list[float | None]) -> str:
    return f"{max(value for value in over_feet if value is not None):.2f}"


def _percent(shares: Iterable[float | None]) -> str:
    """Return the mean of shares over the feet that have any force, in percent."""
    known = [share for share in shares if share is not None]
    return f"{100 * np.mean(known):.0f}" if known else "-"


def spread_over_feet(over_feet: list[float | None]) -> str:
    """Return mean, deviation and worst over the feet that have any force; how many have none."""
    known = [value for value in over_feet if value is not None]
    none = f" ({len(over_feet) - len(known)} without any)" if len(known) < len(over_feet) else ""
    if len(known) < 2:
        return f"{known[0]:.2f}{none}" if known else "-"
    return spread(known) + none


def _figure(kinds: Values) -> Figure:
    """Return the figure of each foot's error over the distance of its loads, in zones of trust."""
    figure = Figure(figsize=(11.0, 4.8), layout="constrained")
    first, last = 1.5, MAX_MEDIAN_MAHALANOBIS_DISTANCE
    axes = figure.subplots()
    for place, (name, columns) in enumerate(kinds.items()):
        one = columns["all"]
        refused, distance = np.array(one["refused"], bool), np.array(one["distance"])
        error_deg = np.array(one["centred"]["true_deg"], float)
        for which, marker in ((~refused, "o"), (refused, "x")):
            axes.scatter(distance[which], error_deg[which], s=16, marker=marker, color=f"C{place}")
        axes.scatter([], [], s=16, color=f"C{place}", label=_KINDS[name].words)
        last = max(last, 1.1 * distance.max())
    edges = (first, WARNING_MEDIAN_MAHALANOBIS_DISTANCE, MAX_MEDIAN_MAHALANOBIS_DISTANCE, last)
    zones = (("C2", "trust"), ("C1", "check"), ("C3", "refused"))
    for span, (color, word) in zip(pairwise(edges), zones, strict=True):
        axes.axvspan(*span, color=color, alpha=0.12, lw=0.0, label=word)
    axes.set(xlim=(first, last), xscale="log", yscale="log", xticks=(2, 4, 8, 16, 32), yticks=(0.5, 1, 2, 5))
    axes.set(xlabel="median distance of the loads from the fitted foot")
    axes.set(ylabel="direction error, centred loads [deg]")
    axes.xaxis.set(major_formatter="{x:g}", minor_formatter="")
    axes.yaxis.set(major_formatter="{x:g}", minor_formatter="")
    figure.legend(fontsize="small", loc="outside right upper")
    return figure
