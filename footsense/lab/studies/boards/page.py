"""Figures of the boards on the page of motion: computed, beside what is wanted of them, and as text."""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from footsense.lab.report import (
    SAME_TABLE,
    StudyContext,
    Values,
    spread,
    table,
    table_by_board,
    target,
)
from footsense.lab.studies.boards.many_feet import (
    BY_STANDING,
    STEP_N,
    missing_figures,
    step_figures,
    wrong_gain_figures,
)
from footsense.lab.studies.boards.service_walks import OWN_END_S, service_figures

#: Least share of the errors within two sigma [1].
_WITHIN_2_SIGMA = 0.93
#: Gains of uncalibrated feet of which something is wanted, a key of `wrong_gain_figures`.
_WANTED_GAINS = "1 %"
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
        touchdown_ms: From the first load to the sending of a touchdown, median and 99 % below; error of its time, rms [ms].
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
    gains = figures["wrong_gains"][_WANTED_GAINS]
    gains_deg = tuple(
        float(np.mean(figures["wrong_gains"][name]["direction_deg"])) for name in (_WANTED_GAINS, BY_STANDING)
    )
    fz_mn = by_load["measured walk"]["rms_mn"][2]
    rows = [
        _target(
            f"{load}, direction, mean / 95 % below",
            wanted_deg,
            (by_load[load]["direction_deg"], by_load[load]["direction_p95_deg"]),
            "{:.2f} / {:.1f} deg",
        )
        for load, wanted_deg in limits.direction_deg.items()
    ]
    rows += [
        _target("measured walk, fz, rms", (limits.fz_mn,), (fz_mn,), "{:.1f} mN"),
        _target(
            f"step of 5 ms to {STEP_N:g} N, settled to 10 %, median / worst",
            limits.settled_ms,
            (step["settled_p50_ms"], step["settled_worst_ms"]),
            "{:.1f} / {:.1f} ms",
        ),
    ]
    if limits.missing_deg is not None:
        rows.append(
            _target(
                "measured walk, an element / a row / a column missing, direction, mean over all of them",
                limits.missing_deg,
                tuple(missing[kind]["direction_deg"] for kind in ("element", "row", "column")),
                "{:.2f} / {:.2f} / {:.2f} deg",
            )
        )
    rows.append(
        _target(
            f"measured walk, gains off by {_WANTED_GAINS}, direction, uncalibrated / calibrated by standing, mean of "
            f"{len(gains['direction_deg'])} draws",
            limits.wrong_gains_deg,
            gains_deg,
            "{:.2f} / {:.2f} deg",
        )
    )
    covered = {load: by_load[load]["within_2_sigma"] for load in _COVERED}
    covered |= {
        "step": step["within_2_sigma"],
        f"gains off by {_WANTED_GAINS}": np.mean(gains["within_2_sigma"]),
        f"gains off by {BY_STANDING}": np.mean(figures["wrong_gains"][BY_STANDING]["within_2_sigma"]),
    }
    covered |= {f"{kind} missing": found["within_2_sigma"] for kind, found in missing.items()}
    least = min(covered, key=lambda row: covered[row])
    rows += [
        target(
            f"errors within 2 sigma, least of gaits, step, elements missing and gains off by {_WANTED_GAINS}",
            f"{_WITHIN_2_SIGMA:.0%}",
            f"{covered[least]:.1%} ({least})",
            met=covered[least] >= _WITHIN_2_SIGMA,
        ),
        _target(
            f"touchdown sent after the first load, measured walk and tripod of {touch['end_s']:g} s, median / 99 %; "
            "back-dated, rms",
            limits.touchdown_ms,
            (touch["delay_p50_ms"], touch["delay_p99_ms"], touch["back_dated_rms_ms"]),
            "{:.1f} / {:.1f} ms; {:.1f} ms",
        ),
    ]
    rows += [
        _target(
            f"{name}, whole service, direction / magnitude, mean",
            wanted,
            (own["direction_deg"], own["magnitude_rel"]),
            "{:.3f} deg / {:.2%}",
            "{:g} deg / {:.0%}",
        )
        for wanted, (name, own) in zip(limits.own_robots, figures["own_robots"].items(), strict=False)
    ]
    return rows


def _target(
    figure: str, wanted: tuple[float, ...], found: tuple[float, ...], cells: str, limit: str | None = None
) -> dict[str, object]:
    """Return the row of figures that are at most what is wanted of each.

    Args:
        figure: The row in words.
        wanted: The most of each.
        found: What was measured.
        cells: Format of what was measured.
        limit: Format of what is wanted, if it is not that with as few digits as there are.
    """
    met = all(one <= most for one, most in zip(found, wanted, strict=True))
    return target(figure, (limit or _plain(cells)).format(*wanted), cells.format(*found), met=met)


def _plain(cells: str) -> str:
    """Return a format whose numbers have as few digits as they need."""
    return re.sub(r"\{:[^}]*\}", "{:g}", cells)


def _named(rows: Mapping[str, Values]) -> list[Values]:
    return [{"name": name} | row for name, row in rows.items()]


def board_text(boards: Mapping[str, Values]) -> str:
    """Return the sections of the boards on the page, from the figures of each."""
    first = next(iter(boards.values()))
    step = table(
        f"board, {SAME_TABLE} | settled, median / worst [ms] | touchdown sent after, median / 99 % [ms]"
        " | soonest [ms] | within 2 sigma",
        {board: figures["step"] for board, figures in boards.items()},
        "`{name}` | {settled_p50_ms:.0f} / {settled_worst_ms:.0f} | {touchdown_p50_ms:.1f} / {touchdown_p99_ms:.1f}"
        " | {soonest_p50_ms:.1f} | {within_2_sigma:.1%}",
    )
    missing = table_by_board(
        f"missing, {SAME_TABLE}: {{name}}, each of {{n_sets}}",
        {board: _named(figures["missing"]) for board, figures in boards.items()},
        {
            "direction mean / 95 % below [deg]": "{direction_deg:.2f} / {direction_p95_deg:.1f}",
            "worst, mean [deg]": "{worst_direction_deg:.2f}",
            "no force": "{no_force_share:.1%}",
            "within 2 sigma": "{within_2_sigma:.1%}",
        },
    )
    gains = table_by_board(
        f"gains off by, standard deviation, {SAME_TABLE}: {{name}}",
        {
            board: [
                {
                    "name": gain,
                    "deg": spread(found["direction_deg"]),
                    "within": np.mean(found["within_2_sigma"]),
                }
                for gain, found in figures["wrong_gains"].items()
            ]
            for board, figures in boards.items()
        },
        {"direction, mean of a draw [deg]": "{deg}", "within 2 sigma, mean of the draws": "{within:.0%}"},
    )
    touchdowns = table(
        f"board, {SAME_TABLE} | touches | sent after, median / 99 % [ms] | time off, rms [ms] | in the air",
        {board: figures["touchdowns"] for board, figures in boards.items()},
        "`{name}` | {n_touches} | {delay_p50_ms:.1f} / {delay_p99_ms:.1f} | {back_dated_rms_ms:.1f} | {n_in_air}",
    )
    own = table_by_board(
        f"robot, {SAME_TABLE}: {{name}}",
        {board: _named(figures["own_robots"]) for board, figures in boards.items()},
        {
            "direction mean / 95 % below [deg]": "{direction_deg:.2f} / {direction_p95_deg:.1f}",
            "magnitude, mean": "{magnitude_rel:.1%}",
            "no force": "{no_force_share:.1%}",
            "within 2 sigma": "{within_2_sigma:.1%}",
        },
    )
    n_draws = len(first["wrong_gains"][_WANTED_GAINS]["direction_deg"])
    return f"""## Steps

{first["step"]["n_steps"]} feet are pressed with {STEP_N:g} N within 5 ms, upright and leaning, at {first["step"]["n_phases"]} phases of a scan; their readings go through the
service's pipeline. *Settled*: from then on the force that was sent last stays within 10 % of the load. *Soonest*: when
the force of the first conversion whose middle is in the load is sent (median); no touchdown can be told sooner. All
times are from the begin of the step.

{step}

## Missing elements

The measured walk of two legs through the service's pipeline; an element, or all of a row or a column, reads nothing from
the start. Each of them in turn.

{missing}

## Wrong gains

Each draw is the measured walk of two uncalibrated feet, whose elements are off by random gains, through the service's
pipeline; {n_draws} draws. Gains that are off turn the force in a way that no window of readings can tell: a foot's own
gains come from its calibration, and what they leave open is added to sigma there. Sigma of a foot that is not calibrated
holds the tolerances of its manufacture, strays, stiffness and mounting; after standing, the latter two. *Calibrated by standing*: the fit of
`footsense test-stand calibrate --no-reference` to the readings of 20 postures, whose forces it does not know.

{gains}

## Through the whole service

Walks with simulated chips, in virtual time, without a fault: touchdowns of the measured walk and the tripod,
{first["touchdowns"]["end_s"]:g} s of each with six legs. A load begins at 1 % of its peak: these rise slowly, and a step's touchdown is above.

{touchdowns}

The larger feet walk with their own loads, scenes `hexapod_2kg` and `quadruped_12kg` for up to {OWN_END_S:g} s; a force counts from a
twentieth of the foot's largest.

{own}{_coupling_text(boards)}"""


def _coupling_text(boards: Mapping[str, Values]) -> str:
    """Return the section of the walk with couplings."""
    walked = table_by_board(
        f"walk, couplings, host, {SAME_TABLE}: {{name}}",
        {board: _named(figures["couplings"]) for board, figures in boards.items()},
        {
            "direction mean / 95 % below [deg]": "{direction_deg:.2f} / {direction_p95_deg:.1f}",
            "magnitude, mean": "{magnitude_rel:.1%}",
            "no force": "{no_force_share:.1%}",
            "within 2 sigma": "{within_2_sigma:.1%}",
        },
    )
    walked = walked.replace("nan / nan", "-").replace("nan%", "-")  # no force at all
    return f"""

Walks of {OWN_END_S:g} s with what lies beside the lines (`effects.couplings`, as the drawn flexes have it, idle inputs at ground,
shields 1 % short): unselected rows count by the error of the shield. *Strays known*: `stray_pf` of the configuration has
what each element reads beside its own capacitance. Clocks of the converters are off by up to what their data sheets allow,
and so are gain and offset of each AD7147. The times are the host's of a transaction.

{walked}"""
