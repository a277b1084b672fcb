"""Tables of the project's targets and the measured values, on top of the report."""

from collections.abc import Mapping
from typing import Any

from footsense.lab.evaluation.compare import DIRECTION_DEG, MAGNITUDE_GF
from footsense.lab.template import render

#: Share of a row's calibrations from which the row counts as refused [1].
_MAX_REFUSED_SHARE = 0.5
#: Loads of the accuracy table, by the name of test and calibration in the study `mismatch`.
_LOAD_LABELS = {
    "centred_all": "centred, 100 gf",
    "centred_few": "the same, calibrated with 20 loads",
    "leaning_all": "leaning up to 35 deg, 100 gf",
    "range_all": "leaning, 20 to 200 gf",
}


def targets_markdown(values: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the tables of the targets as Markdown; missing figures show as not measured.

    Args:
        values: The JSON of the pages, by study.
    """
    gaits = {row["name"]: row for row in values.get("gaits", {}).get("gaits", [])}
    matrix = values.get("mismatch", {}).get("mean_over_feet", {})
    refused = [name for name, row in matrix.items() if row["refused_all"] > _MAX_REFUSED_SHARE]
    names = {
        "refused": refused,
        "accuracy": _accuracy_rows({name: row for name, row in matrix.items() if name not in refused}),
        "DIRECTION_DEG": DIRECTION_DEG,
        "MAGNITUDE_GF": MAGNITUDE_GF,
        "values": values,
        "gaits": gaits,
        # Of feet whose gains are those of the design.
        "sound_gaits": [row for name, row in gaits.items() if "gains" not in name],
    }
    return render(__name__, names)


def _accuracy_rows(accepted: Mapping[str, Mapping[str, float]]) -> list[dict[str, Any]]:
    """Return the rows of the accuracy table: the designed foot, and the worst mismatch that is not refused."""
    if "none" not in accepted:
        return []
    rows = []
    for test, loads in _LOAD_LABELS.items():
        supposed = accepted["none"]
        row: dict[str, Any] = {"loads": loads, "within_2": supposed[f"{test}_within_2"]}
        for unit in ("deg", "gf"):
            figure = f"{test}_{unit}"
            worst = max(accepted, key=lambda name: accepted[name][figure])
            row |= {
                unit: supposed[figure],
                f"worst_{unit}": accepted[worst][figure],
                f"worst_{unit}_of": worst,
            }
        rows.append(row)
    return rows
