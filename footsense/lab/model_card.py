"""README of the released model files: file list, build command, and errors of the network."""

from typing import Any

from footsense.foot.force_errors import ForceErrors
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.lab.evaluation.evaluate_models import HELD_OUT_CASES, as_markdown
from footsense.lab.evaluation.force_range import CENTRED_DEG, LEANS_DEG, force_range
from footsense.lab.foot_file import FOOT_FILE
from footsense.lab.geometry import FootDesign
from footsense.lab.template import render


def readme(
    foot_design: FootDesign,
    response: FootResponse,
    card: dict[str, Any],
    table: dict[str, ForceErrors],
    onnx_difference_n: float,
    *,
    quick: bool,
) -> str:
    """Return the README of a foot type's model files as Markdown."""
    names = {
        "foot_design": foot_design,
        "response": response,
        "card": card,
        "error_table": as_markdown(table),
        "onnx_difference_n": onnx_difference_n,
        "quick": quick,
        "range": force_range(Specimen(response), foot_design.loads.max_n),
        "CENTRED_DEG": CENTRED_DEG,
        "LEANS_DEG": LEANS_DEG,
        "force_unit": foot_design.loads.force_unit,
        "FOOT_FILE": FOOT_FILE,
        "HELD_OUT_CASES": HELD_OUT_CASES,
    }
    return render("lab/model_card.md", names)
