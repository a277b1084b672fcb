"""The project's targets beside the measured figures: the tables on top of the report."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from footsense.lab.evaluation.compare import DIRECTION_DEG, MAGNITUDE_GF
from footsense.lab.template import render

#: The JSON of a page.
Values = Mapping[str, Any]


class Row(NamedTuple):
    """A row of the table, as text."""

    what: str
    before: str
    limits: str
    reached: str
    result: str
    study: str


@dataclass(frozen=True, slots=True)
class _Target:
    """Figures of a page and their limits.

    Attributes:
        what: What is measured.
        before: The figures of the network that read stills.
        wanted: Limit of each figure.
        study: The page that measures.
        figures: Returns the figures from the page's values.
        at_least: Whether the limits are the least instead of the most.
    """

    what: str
    before: str
    wanted: tuple[float, ...]
    study: str
    figures: Callable[[Values], list[float]]
    at_least: bool = False

    def row(self, values: Mapping[str, Values]) -> Row:
        """Return the row of the table; a figure that was not measured says so."""
        limits = ("at least " if self.at_least else "at most ") + " / ".join(
            f"{limit:g}" for limit in self.wanted
        )
        if self.study not in values:
            return Row(self.what, self.before, limits, "-", "not measured", self.study)
        reached = self.figures(values[self.study])
        sign = -1.0 if self.at_least else 1.0
        met = [sign * figure <= sign * limit for figure, limit in zip(reached, self.wanted, strict=True)]
        result = "met" if all(met) else "missed" if not any(met) else "met in part"
        text = " / ".join(f"{figure:.3g}" for figure in reached)
        return Row(self.what, self.before, limits, text, result, self.study)


def _figures_of_gait(name: str, *keys: str) -> Callable[[Values], list[float]]:
    """Return a function that returns figures of one row of the page `gaits`."""

    def figures(page: Values) -> list[float]:
        [row] = [row for row in page["gaits"] if row["name"] == name]
        return [row[key] for key in keys]

    return figures


def _direction_target(what: str, name: str, before: str, wanted: tuple[float, float]) -> _Target:
    """Return the target of a gait's direction errors."""
    figures = _figures_of_gait(name, "direction_deg", "direction_p95_deg")
    return _Target(f"{what}, direction, mean / 95 % below [deg]", before, wanted, "gaits", figures)


def _mean_direction_target(what: str, before: str, wanted: float) -> _Target:
    """Return the target of the mean direction error of a walk whose name is `what`."""
    return _Target(f"{what}, mean [deg]", before, (wanted,), "gaits", _figures_of_gait(what, "direction_deg"))


def _least_within(page: Values) -> list[float]:
    """Return the least share of errors within two sigma of all gaits of a sound foot [%]."""
    return [100.0 * min(row["within_2_sigma"] for row in page["gaits"] if "gains" not in row["name"])]


_TARGETS = (
    _direction_target("random gaits", "random gaits", "9.4 / 30", (2, 8)),
    _direction_target("measured walk", "measured walk", "3.2 / 12.6", (0.8, 3)),
    _Target(
        "measured walk, fx / fy / fz, rms [mN]",
        "22 / 20 / 11",
        (6, 4, 8),
        "gaits",
        lambda page: next(row["rms_mn"] for row in page["gaits"] if row["name"] == "measured walk"),
    ),
    _direction_target("tripod", "tripod", "2.3 / 8.1", (0.7, 2.5)),
    _mean_direction_target("walk, rubber creeps and lags", "3.1", 0.9),
    _mean_direction_target("walk, middle element missing", "12.5", 1.3),
    _mean_direction_target("walk, row 0 missing", "10.6", 2),
    _mean_direction_target("walk, gains off by 1 %", "4.0", 1.8),
    _mean_direction_target("walk, gains off by 3 %", "6.8", 4),
    _Target(
        "errors within 2 sigma, least of all gaits [%]", "81", (93,), "gaits", _least_within, at_least=True
    ),
    _Target(
        "errors within 2 sigma, walk with gains off by 1 % [%]",
        "-",
        (90,),
        "gaits",
        lambda page: [
            100.0 * share for share in _figures_of_gait("walk, gains off by 1 %", "within_2_sigma")(page)
        ],
        at_least=True,
    ),
    _Target(
        "step of 5 ms, settled to 10 %, median / worst [ms]",
        "83 / 109",
        (45, 70),
        "tradeoff",
        lambda page: page["loads"]["step"]["methods"][0]["settling_ms"],
    ),
    _Target(
        "touchdown on hard ground, median / 99 % below [ms]",
        "27 / 33",
        (6, 12),
        "touchdown",
        lambda page: page["latencies"]["hard, upright"]["contact_ms"],
    ),
    _Target(
        "false touchdowns while the leg swings",
        "0",
        (0,),
        "touchdown",
        lambda page: [sum(page["false_reports"]["contact"])],
    ),
    _Target(
        "time of touchdown, back-dated, rms [ms]",
        "-",
        (2,),
        "gait-semantics",
        lambda page: [page["touchdown_ms"]],
    ),
    _Target(
        "walk, friction use / ground normal [deg]",
        "-",
        (0.015, 2),
        "gaits",
        _figures_of_gait("measured walk", "friction", "normal_deg"),
    ),
    _Target(
        "rough ground, friction use / ground normal [deg]",
        "-",
        (0.015, 2),
        "gait-semantics",
        lambda page: [page["friction"], page["normal_deg"]],
    ),
    _Target(
        "slip until said [mm] / missed [%] / false [1/h]",
        "-",
        (3, 2, 1),
        "gait-semantics",
        lambda page: [
            page["slid_mm"],
            100.0 * page["missed_slides"],
            page["false_slips"] / page["leg_hours"],
        ],
    ),
)


def targets(values: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the tables of the targets as Markdown; a missing figure is shown as not measured.

    Args:
        values: The JSON of the pages, by study.
    """
    names = {
        "DIRECTION_DEG": DIRECTION_DEG,
        "MAGNITUDE_GF": MAGNITUDE_GF,
        "values": values,
        "motion": [target.row(values) for target in _TARGETS],
    }
    return render(__name__, names)
