"""The project's targets beside the measured figures: the table on top of the report."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from footsense.lab.evaluation.compare import DIRECTION_DEG, MAGNITUDE_GF
from footsense.lab.template import render

#: The JSON of the pages, by study.
Values = Mapping[str, Mapping[str, Any]]


class Target(NamedTuple):
    """One target of the report: wanted value, paper value, and the study that measures the figure.

    Attributes:
        what: In words, with its unit.
        paper: The paper's figure, if its text gives one.
        wanted: The figure; a minimum if `at_least`.
        study: The study that measures it.
        path: Keys of the measured figure in the study's JSON, or a function of that JSON.
        at_least: Whether more is better.
    """

    what: str
    paper: str
    wanted: float
    study: str
    path: str | Callable[[Mapping[str, Any]], float | None]
    at_least: bool = False

    def measured(self, values: Values) -> float | None:
        """Return the measured figure of the target from the studies' values; None if not measured."""
        found: Any = values.get(self.study)
        if found is None:
            return None
        if not isinstance(self.path, str):
            return self.path(found)
        for key in self.path.split("."):
            found = found and found[key]
        return None if found is None else float(found)


def _worst_solid(values: Mapping[str, Any]) -> float | None:
    """Return the released mesh's worst closure error over both loads [%]."""
    worst = [mesh["worst_rel"] for mesh in values["meshes"] if mesh["name"] == "SHIPPED"]
    return 100.0 * max(worst[0]) if worst else None


def _worst_ratio(values: Mapping[str, Any]) -> float:
    """Return the network's direction error over the bound's in the worst bin of centred loads."""
    bins = values["ratio"]["centred"]
    return max(
        float(one["network"]["direction_rms_deg"] / one["leaning"]["direction_rms_deg"]) for one in bins
    )


def _table_ratio(values: Mapping[str, Any]) -> float:
    """Return the time ratio of one forward solve to the response table [1]."""
    return float(values["forward"]["forward_s"] / values["forward"]["table_s"])


_ERRORS = "errors.paper_network"
_MADE = "feet at the paper's fabrication tolerances"
TARGETS = (
    Target(
        "released network, direction, mean [deg]",
        "2.4",
        DIRECTION_DEG,
        "released",
        f"{_ERRORS}.direction_deg",
    ),
    Target(
        "released network, magnitude, mean [gf]", "5.3", MAGNITUDE_GF, "released", f"{_ERRORS}.magnitude_gf"
    ),
    Target("its weights", "-", 2000.0, "released", "weights"),
    Target(
        "trained on the 362 cases alone, direction [deg]",
        "2.4",
        0.5,
        "released",
        f"{_ERRORS}_362.direction_deg",
    ),
    Target(
        "trained on the 362 cases alone, magnitude [gf]",
        "5.3",
        0.8,
        "released",
        f"{_ERRORS}_362.magnitude_gf",
    ),
    Target("network over the Cramer-Rao bound, worst of 20 to 150 gf", "-", 1.2, "cramer-rao", _worst_ratio),
    Target("free closures of two loads against finer meshes, worst [%]", "-", 1.0, "solid", _worst_solid),
    Target("from nothing to the complete response [s]", "-", 60.0, "solid", "response.wall_s"),
    Target("542 cases with gap contact [s]", "-", 30.0, "solid", "cases.wall_s"),
    Target(
        "one forward solve per case over the table, time", "-", 50.0, "fidelity", _table_ratio, at_least=True
    ),
    *(
        Target(f"{_MADE}, {loads}, {what}", paper, wanted, "experiment", f"estimators.{key}.mean")
        for loads, what, paper, wanted, key in (
            ("all loads", "direction [deg]", "15.9", 1.6, "calibrated_362.direction_deg"),
            ("all loads", "magnitude [gf]", "18.7", 1.9, "calibrated_362.magnitude_gf"),
            ("20 loads", "direction [deg]", "15.9", 3.0, "calibrated_20.direction_deg"),
            ("20 loads", "magnitude [gf]", "18.7", 4.0, "calibrated_20.magnitude_gf"),
        )
    ),
    Target("all of this from nothing [min]", "-", 60.0, "report", "minutes"),
)


def targets(values: Values) -> str:
    """Return the table of the targets; a figure that was not measured says so.

    Args:
        values: The JSON of the pages, by study.
    """
    return render(__name__, {"TARGETS": TARGETS, "values": values})
