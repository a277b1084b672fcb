"""Figures of the boards on the page of motion, beside what is wanted of them."""

from typing import NamedTuple

import numpy as np

from footsense.lab.report import StudyContext, Values, target, target_at_most
from footsense.lab.studies.boards.many_feet import (
    BY_STANDING,
    STEP_N,
    UNCALIBRATED,
    missing_figures,
    step_figures,
    wrong_gain_figures,
)
from footsense.lab.studies.boards.service_walks import service_figures

#: Least share of the errors within two sigma [1].
_WITHIN_2_SIGMA = 0.93
#: Loads of a page whose errors have to be within two sigma.
_COVERED = ("random gaits", "measured walk", "tripod", "trot of a robot dog")


class BoardLimits(NamedTuple):
    """What is wanted of a board on the paper's foot, but for the robots.

    Attributes:
        direction_deg: Errors of direction, mean and 95 % below, by load [deg].
        fz_mn: Error of fz in the measured walk, rms [mN].
        settled_ms: Time until a step has settled, median and worst [ms].
        wrong_gains_deg: Direction in the walk with gains off by 1 %, mean of the draws, uncalibrated and calibrated by
            standing [deg].
        touchdown_ms: From the first load to the sending of a touchdown, median and 99 % below; error of its time [ms].
        missing_deg: Direction in the walk with an element, a row and a column missing, mean [deg]; None if nothing is
            wanted.
        own_robots: Direction [deg] and magnitude [1], means, of the larger feet's robots, in their order; none if
            nothing is wanted.
    """

    direction_deg: dict[str, tuple[float, float]]
    fz_mn: float
    settled_ms: tuple[float, float]
    wrong_gains_deg: tuple[float, float]
    touchdown_ms: tuple[float, float, float]
    missing_deg: tuple[float, float, float] | None = None
    own_robots: tuple[tuple[float, float], ...] = ()


def board_figures(context: StudyContext, board: str) -> Values:
    """Return the figures of a board by section of the page.

    Args:
        context: As of every study.
        board: A key of `SCAN_TIMES`.
    """
    figures = {
        "step": step_figures(context, board),
        "missing": missing_figures(context, board),
        "wrong_gains": wrong_gain_figures(context, board),
    }
    context.report_progress("steps, missing elements and wrong gains done")
    figures |= service_figures(context, board)
    context.report_progress("walks through the service done")
    return figures


def board_targets(gaits: list[Values], figures: Values, limits: BoardLimits) -> list[dict[str, object]]:
    """Return the targets of a board.

    Args:
        gaits: Errors of the network by `load`.
        figures: Those of `board_figures`.
        limits: What is wanted.
    """
    by_load = {row["load"]: row for row in gaits}
    step, missing, touch = (figures[name] for name in ("step", "missing", "touchdowns"))
    gains = figures["wrong_gains"][UNCALIBRATED]
    gains_deg = tuple(
        float(np.mean(figures["wrong_gains"][name]["direction_deg"])) for name in (UNCALIBRATED, BY_STANDING)
    )
    fz_mn = by_load["measured walk"]["rms_mn"][2]
    rows = [
        target_at_most(
            f"{load}, direction, mean / 95 % below",
            wanted_deg,
            (by_load[load]["direction_deg"], by_load[load]["direction_p95_deg"]),
            "{:.2f} / {:.1f} deg",
        )
        for load, wanted_deg in limits.direction_deg.items()
    ]
    rows += [
        target_at_most("measured walk, fz, rms", (limits.fz_mn,), (fz_mn,), "{:.1f} mN"),
        target_at_most(
            f"step of 5 ms to {STEP_N:g} N, settled to 10 %, median / worst",
            limits.settled_ms,
            (step["settled_p50_ms"], step["settled_worst_ms"]),
            "{:.1f} / {:.1f} ms",
        ),
    ]
    if limits.missing_deg is not None:
        rows.append(
            target_at_most(
                "measured walk, an element / a row / a column missing, direction, mean over all of them",
                limits.missing_deg,
                tuple(missing[kind]["direction_deg"] for kind in ("element", "row", "column")),
                "{:.2f} / {:.2f} / {:.2f} deg",
            )
        )
    rows.append(
        target_at_most(
            f"measured walk, gains off by {UNCALIBRATED}, direction, uncalibrated / calibrated by standing, mean of "
            f"{len(gains['direction_deg'])} draws",
            limits.wrong_gains_deg,
            gains_deg,
            "{:.2f} / {:.2f} deg",
        )
    )
    covered = {load: by_load[load]["within_2_sigma"] for load in _COVERED}
    covered |= {
        "step": step["within_2_sigma"],
        f"gains off by {UNCALIBRATED}": np.mean(gains["within_2_sigma"]),
        f"gains off by {BY_STANDING}": np.mean(figures["wrong_gains"][BY_STANDING]["within_2_sigma"]),
    }
    covered |= {f"{kind} missing": found["within_2_sigma"] for kind, found in missing.items()}
    least = min(covered, key=lambda row: covered[row])
    rows += [
        target(
            f"errors within 2 sigma, least of gaits, step, elements missing and gains off by {UNCALIBRATED}",
            f"{_WITHIN_2_SIGMA:.0%}",
            f"{covered[least]:.1%} ({least})",
            met=covered[least] >= _WITHIN_2_SIGMA,
        ),
        target_at_most(
            f"touchdown sent after the first load, measured walk and tripod of {touch['end_s']:g} s, median / 99 %; "
            "back-dated, rms",
            limits.touchdown_ms,
            (touch["delay_p50_ms"], touch["delay_p99_ms"], touch["back_dated_rms_ms"]),
            "{:.1f} / {:.1f} ms; {:.1f} ms",
        ),
    ]
    rows += [
        target_at_most(
            f"{name}, whole service, direction / magnitude, mean",
            wanted,
            (own["direction_deg"], own["magnitude_rel"]),
            "{:.3f} deg / {:.2%}",
            "{:g} deg / {:.0%}",
        )
        for wanted, (name, own) in zip(limits.own_robots, figures["own_robots"].items(), strict=False)
    ]
    return rows
