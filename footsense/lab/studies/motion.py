"""Page `motion`: forces of feet that move, what a gait controller is told of them, and when."""

from collections.abc import Sequence
from functools import partial
from itertools import chain, pairwise

import numpy as np

from footsense.foot.network_card import NETWORK_FILE
from footsense.lab.evaluation import walker_scores
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE
from footsense.lab.evaluation.walker_judgement import (
    JudgedRun,
    contact_figures,
    judge,
    pooled,
    slip_figures,
)
from footsense.lab.evaluation.walker_runs import HOST_COST_US, SCAN_TIMES, ToldMotion
from footsense.lab.foot_file import FOOT_FILE
from footsense.lab.report import StudyContext, Values
from footsense.lab.studies.boards.many_feet import missing_figures, step_figures
from footsense.lab.studies.boards.service_walks import END_S, KNOWN_STRAYS, OWN_FEET, TRIPOD, service_figures
from footsense.lab.walkers import slow_loads
from footsense.lab.walkers.gaits import GAITS_FILE
from footsense.lab.walkers.made_up import SHAKING, SLOW, MadeUpLoads
from footsense.lab.walkers.split import KNOWN_JUDGEMENT, NEW_JUDGEMENT, RECORDED_JUDGEMENT, WalkerRun

TITLE = "Force in motion, and what a gait controller is told"

#: Slow loads that judge; those of the selection have other seeds.
_SLOW = (MadeUpLoads(SLOW, 9900, 20.0), MadeUpLoads(SLOW, 9901, 20.0))
_SHAKING = MadeUpLoads(SHAKING, 9950, 20.0)
#: Runs of a quick page, and duration of those in new gaits [s].
_QUICK_RUNS, _QUICK_NEW_RUNS, _QUICK_S = slice(1, None, 12), slice(0, None, 13), 4.0


def compute(context: StudyContext) -> Values:
    """Judge the feet of each board by walking robots, and by walks through the whole service."""
    return {"boards": {board: _figures(context, board) for board in SCAN_TIMES}}


def _figures(context: StudyContext, board: str) -> Values:
    """Return the figures of a board."""
    feet = [context, *(context.foot(name) for name in OWN_FEET)]
    folders = [foot.files(FOOT_FILE, RESPONSE_FILE, NETWORK_FILE) for foot in feet]
    figures = {"step": step_figures(context, board), "missing": missing_figures(context, board)}
    context.report_progress(f"{board}: steps and missing elements done")
    figures |= service_figures(context, board)
    context.report_progress("walks through the service done")
    judged_under = partial(judge, folders, board=board)
    new: tuple[WalkerRun, ...] = NEW_JUDGEMENT
    slow: tuple[MadeUpLoads, ...] = _SLOW
    for file in (GAITS_FILE, *(walk.file for walk in RECORDED_JUDGEMENT)):
        context.table_file(file)
    if context.quick:
        new = tuple(run._replace(duration_s=_QUICK_S) for run in NEW_JUDGEMENT[_QUICK_NEW_RUNS])
        slow = (_SLOW[0]._replace(duration_s=_QUICK_S),)
    judged = judged_under(KNOWN_JUDGEMENT[_QUICK_RUNS] if context.quick else KNOWN_JUDGEMENT)
    new_judged, slow_judged = judged_under((*new, *RECORDED_JUDGEMENT)), judged_under(slow)
    shaking = judged_under((_SHAKING._replace(duration_s=_QUICK_S) if context.quick else _SHAKING,))
    moving = judged_under((*new, *RECORDED_JUDGEMENT, *slow), motion=ToldMotion())
    context.report_progress("walking robots done")
    by_foot = {
        name: [one for one in judged if one.foot_type == name]
        for name in dict.fromkeys(one.foot_type for one in judged)
    }
    walked = [*judged, *new_judged]
    slips = {"all": slip_figures(walked)}
    slips |= {name: slip_figures([one for one in walked if one.foot_type == name]) for name in by_foot}
    return figures | {
        "runs": {name: [_row(one) for one in by_foot[name]] for name in list(by_foot)[1:]},
        "pooled": {name: pooled(runs) for name, runs in by_foot.items()},
        "new_gaits": _contacts_by_gait(new_judged),
        "shaking": [_row(one) for one in shaking],
        "contacts": contact_figures([*new_judged, *slow_judged]),
        "contacts_with_motion": contact_figures(moving),
        "slips": slips,
    }


def _row(one: JudgedRun) -> Values:
    """Return what the page says of the forces of one run."""
    return {"run": one.run.name, "foot_type": one.foot_type, "peak_n": one.peak_n} | {
        key: one.scores[key] for key in _FORCES
    }


#: What the page says of the forces of a run, of its scores.
_FORCES = (
    *("direction_deg", "direction_p95_deg", "mid_stance_deg"),
    *("no_force_share", "overload_share", "within_2_sigma", "beyond_5_sigma"),
)


def _contacts_by_gait(judged: Sequence[JudgedRun]) -> list[Values]:
    """Return what became of the touches in each gait of a robot, on all grounds and feet together."""
    by_gait: dict[str, list[Values]] = {}
    for one in judged:
        by_gait.setdefault(" ".join(one.run.name.split()[:2]), []).append(one.scores)
    return [
        {"gait": gait, "wrong_share": np.mean([row["wrong_share"] for row in rows])}
        | {key: sum(row[key] for row in rows) for key in ("n_touches", "n_missed", "n_twice", "n_in_air")}
        for gait, rows in by_gait.items()
    ]


def shown(values: Values) -> Values:
    """Return what the targets say of each board, walks of more than one kind, and where constants are."""
    boards = values["boards"]
    return {
        "boards": {board: one | _derived(one) for board, one in boards.items()},
        "holds_bounds": list(pairwise(walker_scores.HOLDS_BOUNDS)),
        "walks": {board: one["own_robots"] | one["couplings"] for board, one in boards.items()},
        "of_own_robots": {board: list(chain(*one["runs"].values())) for board, one in boards.items()},
        "host_cost_us": HOST_COST_US,
        "end_s": END_S,
        "motion": ToldMotion(),
        "scores": walker_scores,
        "slow": slow_loads,
    }


def _derived(figures: Values) -> Values:
    """Return the paper's foot on walking robots, in walk and tripod, least coverage, and worst shaking."""
    cases = {"step": figures["step"]} | {
        f"{kind} missing": found for kind, found in figures["missing"].items()
    }
    share, case = min((found["within_2_sigma"], case) for case, found in cases.items())
    return {
        "own": next(iter(figures["pooled"].values())),
        "walk": figures["couplings"][KNOWN_STRAYS],
        "tripod": figures["couplings"][TRIPOD],
        "least_within": {"share": share, "case": case},
        "shaken_deg": max(row["mid_stance_deg"] for row in figures["shaking"]),
    }
