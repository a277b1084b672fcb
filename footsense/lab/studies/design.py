"""Page `design`: range and errors of the released feet, as predicted from solved shapes and from their own tables."""

from typing import Any

import numpy as np

from footsense.foot.specimen import Specimen
from footsense.lab.design.assess import assess_foot
from footsense.lab.design.materials import MATERIALS_TABLE, load_materials
from footsense.lab.design.processes import PROCESSES_TABLE, assumed_process
from footsense.lab.design.requirements import PITCH_DEG, Requirements, converter
from footsense.lab.design.screen import TRAINED_RANGE_FACTOR
from footsense.lab.design.shapes import SHAPES_FILE, FootShapeLibrary
from footsense.lab.evaluation.force_range import (
    CENTRED_DEG,
    LEANS_DEG,
    MAX_READABLE_CLOSURE_REL,
    UPRIGHT,
    friction_loads,
    largest_loads_n,
)
from footsense.lab.report import StudyContext, Values
from footsense.lab.training.load_cases import FULL_SCALE_PF
from footsense.sim.fabrication import draw_deviations

TITLE = "Designed feet: range and error, predicted and built"

PAPER_FOOT = "aoyagi-3x3"
_FOOT_TYPES = (PAPER_FOOT, "hexapod-2kg", "quadruped-12kg")
_N_FEET, _QUICK_N_FEET, SEED = 20, 2, 0
#: Figures that are compared, of those of `assess_foot`.
_COMPARED = (
    *("design_range_n", "upright_range_n", "centred_range_n"),
    *("direction_error_bound_deg", "magnitude_error_bound_rel"),
    *("calibrated_direction_error_deg", "calibrated_magnitude_error_rel"),
)


def compute(context: StudyContext) -> Values:
    """Assess each released foot from shapes and from its table, then the ranges of made feet."""
    library, feet = FootShapeLibrary(context.table_file(SHAPES_FILE)), {}
    for file in (MATERIALS_TABLE, PROCESSES_TABLE):
        context.table_file(file)
    for foot_type in _FOOT_TYPES:
        feet[foot_type] = _foot(context.foot(foot_type), library)
        context.report_progress(f"{foot_type} done")
    return {"n_feet": _QUICK_N_FEET if context.quick else _N_FEET, "feet": feet}


def _foot(context: StudyContext, library: FootShapeLibrary) -> Values:
    """Return range and errors of one foot, predicted and built, its limits by lean, and those of made feet."""
    design, response = context.foot_design, context.response
    process, stated_n = assumed_process(design), design.loads.max_n / TRAINED_RANGE_FACTOR
    requirements = Requirements(
        stated_n,
        stated_n / 20.0,
        LEANS_DEG[-1],
        1.0,
        (20.0, 60.0),
        load_materials(),
        process.process,
        converter("fdc1004"),
    )
    tables = {"predicted": library.response(design), "built": response}
    n_feet = _QUICK_N_FEET if context.quick else _N_FEET
    made = [draw_deviations(response, process.rms_deviations, SEED, foot) for foot in range(n_feet)]
    leaning = friction_loads(UPRIGHT, LEANS_DEG[-1])
    return {
        "stated_n": stated_n,
        "trained_n": design.loads.max_n,
        **{name: assess_foot(design, one, requirements)._asdict() for name, one in tables.items()},
        "process": process.process_name,
        "made_range_n": [float(largest_loads_n(Specimen(response, one), leaning).min()) for one in made],
    }


def _differences(foot: Values) -> list[float]:
    """Return how far each built figure is from its prediction, over the prediction [1]."""
    pairs = [(np.array(foot["predicted"][name]), np.array(foot["built"][name])) for name in _COMPARED]
    return [float(np.abs(built / predicted - 1.0).max()) for predicted, built in pairs]


def shown(values: Values) -> Values:
    """Return how far built figures are from predicted ones, and where constants are."""
    feet: dict[str, Any] = values["feet"]
    designs = [foot for name, foot in feet.items() if name != PAPER_FOOT]
    differences_percent = {name: 100 * max(_differences(foot)) for name, foot in feet.items()}
    return {
        "differences": [f"{percent:.1f} % ({name})" for name, percent in differences_percent.items()],
        "largest_difference_percent": max(differences_percent.values()),
        "least_made_n": {name: min(foot["made_range_n"]) for name, foot in feet.items()},
        "n_short": sum(range_n < foot["stated_n"] for foot in designs for range_n in foot["made_range_n"]),
        "leans_deg": LEANS_DEG,
        "pitch_deg": PITCH_DEG,
        "centred_deg": CENTRED_DEG,
        "max_readable_rel": MAX_READABLE_CLOSURE_REL,
        "full_scale_pf": FULL_SCALE_PF,
        "trained_factor": TRAINED_RANGE_FACTOR,
    }
