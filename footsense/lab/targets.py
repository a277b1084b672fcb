"""What the lab set out to reach, and what it reached: the table on top of the report, from the studies' numbers."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from footsense.lab.evaluation.compare import DIRECTION_DEG, MAGNITUDE_GF
from footsense.lab.studies.page import table

#: What the studies measured, by study.
Values = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class Target:
    """One thing to reach.

    Attributes:
        what: In words, with its unit.
        study: The study that measured it.
        wanted: The figure.
        found: Picks the measured one from the study's values.
        at_least: Whether more is better.
        paper: The paper's figure, if its text gives one.
    """

    what: str
    study: str
    wanted: float
    found: Callable[[Mapping[str, Any]], float | None]
    at_least: bool = False
    paper: str = "-"


def _error(row: str, figure: str) -> Callable[[Mapping[str, Any]], float]:
    """Return what picks a mean error from the released network's table."""
    return lambda values: float(values["errors"][row][figure])


def _worst_solid(values: Mapping[str, Any]) -> float | None:
    """Return the released mesh's worst closure error over both loads [%]."""
    worst = [mesh["worst_rel"] for mesh in values["meshes"] if mesh["name"] == "SHIPPED"]
    return 100.0 * max(worst[0]) if worst else None


def _worst_ratio(values: Mapping[str, Any]) -> float | None:
    """Return the network's direction error over the bound's in the worst bin of centred loads."""
    bins = values["ratio"]["centred"]
    return max(
        float(one["network"]["direction_rms_deg"] / one["leaning"]["direction_rms_deg"]) for one in bins
    )


def _of_feet(way: str, figure: str) -> Callable[[Mapping[str, Any]], float]:
    """Return what picks the mean over feet of one way to read them."""
    return lambda values: float(values[way][figure]["mean"])


TARGETS = (
    Target(
        "released network, direction, mean [deg]",
        "released",
        DIRECTION_DEG,
        _error("paper_network", "direction_deg"),
        paper="2.4",
    ),
    Target(
        "released network, magnitude, mean [gf]",
        "released",
        MAGNITUDE_GF,
        _error("paper_network", "magnitude_gf"),
        paper="5.3",
    ),
    Target("its weights", "released", 2000.0, lambda values: float(values["weights"])),
    Target(
        "trained on the 362 cases alone, direction [deg]",
        "released",
        0.5,
        _error("paper_network_362", "direction_deg"),
        paper="2.4",
    ),
    Target(
        "trained on the 362 cases alone, magnitude [gf]",
        "released",
        0.8,
        _error("paper_network_362", "magnitude_gf"),
        paper="5.3",
    ),
    Target(
        "network over the Cramer-Rao bound, worst of 20 to 150 gf",
        "cramer-rao",
        1.2,
        _worst_ratio,
    ),
    Target("free closures of two loads against finer meshes, worst [%]", "solid", 1.0, _worst_solid),
    Target(
        "from nothing to the complete response [s]",
        "solid",
        60.0,
        lambda values: (values["response"] or {}).get("wall_s"),
    ),
    Target("542 cases with gap contact [s]", "solid", 30.0, lambda values: float(values["cases"]["wall_s"])),
    Target(
        "one forward solve per case over the table, time",
        "fidelity",
        50.0,
        lambda values: float(values["forward"]["forward_s"] / values["forward"]["table_s"]),
        at_least=True,
    ),
    *(
        Target(
            f"feet at the paper's fabrication tolerances, {words}, {what} [{unit}]",
            "experiment",
            wanted,
            _of_feet(way, key),
            paper=paper,
        )
        for way, words, wanted_deg, wanted_gf in (
            ("calibrated_362", "all loads", 1.6, 1.9),
            ("calibrated_20", "20 loads", 3.0, 4.0),
        )
        for what, unit, key, wanted, paper in (
            ("direction", "deg", "direction_deg", wanted_deg, "15.9"),
            ("magnitude", "gf", "magnitude_gf", wanted_gf, "18.7"),
        )
    ),
    Target("all of this from nothing [min]", "report", 60.0, lambda values: values["minutes"]),
)


def targets(values: Values) -> str:
    """Return the table of what was to be reached; a figure that was not measured says so.

    Args:
        values: What the studies measured, by study.
    """
    rows = []
    for target in TARGETS:
        found = target.found(values[target.study]) if target.study in values else None
        if found is None:
            verdict, shown = "not measured", "-"
        else:
            met = found >= target.wanted if target.at_least else found <= target.wanted
            factor = target.wanted / found if target.at_least else found / target.wanted
            verdict, shown = "met" if met else f"missed by a factor of {factor:.3g}", f"{found:.3g}"
        limit = f"{'at least' if target.at_least else 'at most'} {target.wanted:g}"
        rows.append([target.what, target.paper, limit, shown, verdict, f"`{target.study}`"])
    reached = table(["figure", "the paper", "target", "ours", "", "study"], rows)
    return f"{reached}\n\n{_why(values['cramer-rao'])}" if "cramer-rao" in values else reached


def _why(cramer_rao: Mapping[str, Any]) -> str:
    """Return why the network misses the bound, from the numbers of the study `cramer-rao`."""
    heaviest = cramer_rao["ratio"]["centred"][-1]
    own = cramer_rao["noiseless_direction_rms_deg"][-1] / heaviest["network"]["direction_rms_deg"]
    rounds = ", ".join(f"{what}: {row[0]['ratio']:.2f}" for what, row in cramer_rao["gauss_newton"].items())
    return (
        f"The Cramer-Rao bound falls with the load faster than the network's own error: at "
        f"{heaviest['magnitude_gf']:g} gf that makes {own**2:.0%} of its squared error, noise the rest. More "
        f"weights reduce it (study `network-size`); one round of Gauss-Newton on the response table, started at its "
        f"estimate, brings these multiples of the bound where it explains the scan ({rounds}). Nothing released does "
        f"that yet."
    )
