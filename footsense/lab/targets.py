"""The project's targets beside the measured figures: the tables on top of the report."""

from collections.abc import Mapping
from typing import Any

from footsense.lab.evaluation.compare import DIRECTION_DEG, MAGNITUDE_GF
from footsense.lab.template import render


def targets(values: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the tables of the targets as Markdown; a missing figure is shown as not measured.

    Args:
        values: The JSON of the pages, by study.
    """
    gaits = {row["name"]: row for row in values.get("gaits", {}).get("gaits", [])}
    names = {
        "DIRECTION_DEG": DIRECTION_DEG,
        "MAGNITUDE_GF": MAGNITUDE_GF,
        "values": values,
        "gaits": gaits,
        # Of feet whose gains are those of the design.
        "sound_gaits": [row for name, row in gaits.items() if "gains" not in name],
    }
    return render(__name__, names)
