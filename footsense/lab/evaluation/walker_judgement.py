"""Judgement of the feet by walking robots: each judging run through the service's pipeline, and scored."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from footsense.estimation.network import Network
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE
from footsense.lab.evaluation.walker_runs import (
    SCAN_TIMES,
    ToldMotion,
    judging_pipeline,
    read_walker,
    run_pipeline,
    walker_loads,
)
from footsense.lab.evaluation.walker_scores import (
    HOLDS_BOUNDS,
    REPORT_AFTER_S,
    scores,
)
from footsense.lab.foot_file import FOOT_FILE, load_foot
from footsense.lab.parallel import compute_each
from footsense.lab.walkers.made_up import SLOW, MadeUpLoads
from footsense.lab.walkers.split import DRAGGED, LoggedRun, WalkerRun

#: Peak of loads of another robot than a foot's own, to which each log is scaled, over the foot's range [1].
PEAK_REL = 0.5
#: Seed of the readings' noise.
_SEED = 20_000
#: Gaits whose landings are hard: their forces are beyond what a walking robot makes.
LANDINGS = ("landing",)


#: Loads of the feet of a robot, to judge by.
JudgingLoads = WalkerRun | LoggedRun | MadeUpLoads


class JudgedRun(NamedTuple):
    """One run on a foot: foot type, the run, its peak force [N], and scores."""

    foot_type: str
    run: JudgingLoads
    peak_n: float
    scores: dict[str, Any]


def judge_run(
    part: tuple[JudgingLoads, Sequence[Path]], board: str, motion: ToldMotion | None
) -> list[JudgedRun]:
    """Return the scores of one run on feet.

    A foot of the robot's own gets its forces, another one forces scaled to a peak of `PEAK_REL` of its range.

    Args:
        part: The run, and the folder of each foot type.
        board: A key of `SCAN_TIMES`.
        motion: How the motion of the legs is told; None where it is not.
    """
    run, models = part
    scan = SCAN_TIMES[board]
    log, judged = run.kept_log(), []
    for folder in models:
        design, response = load_foot(folder / FOOT_FILE), FootResponse.load(folder / RESPONSE_FILE)
        network = Network(folder / NETWORK_FILE, len(log.legs))
        own = run.name.startswith(f"{design.foot_type} ")
        scale = 1.0 if own else PEAK_REL * design.loads.max_n / log.peak_n()
        loads = walker_loads(log, scale, design.ball_radius_mm)
        readings = read_walker(Specimen(response), loads, _SEED + run.seed, scan=scan)
        feet = [None] * len(log.legs)
        pipeline = judging_pipeline(network, response, scan, feet, friction=log.friction)
        outputs = run_pipeline(pipeline, readings, motion)
        peak_n = scale * log.peak_n()
        found = scores(outputs, peak_n, np.inf if run.gait == SLOW else REPORT_AFTER_S)
        judged.append(JudgedRun(design.foot_type, run, peak_n, found))
    return judged


def judge(
    models: Sequence[Path],
    runs: Sequence[JudgingLoads],
    board: str,
    motion: ToldMotion | None = None,
) -> list[JudgedRun]:
    """Return the scores of runs on feet; each foot but the paper's gets the runs of robots of its own kind.

    Args:
        models: Folders of the foot types, the paper's first.
        runs: The runs.
        board: As of `judge_run`.
        motion: As of `judge_run`.
    """
    parts = [
        (run, tuple(folder for n, folder in enumerate(models) if not n or folder.name.startswith(run.kind)))
        for run in runs
    ]
    judged = compute_each(partial(judge_run, board=board, motion=motion), parts)
    return [one for each in judged for one in each]


def contact_figures(judged: Sequence[JudgedRun]) -> dict[str, Any]:
    """Return what became of the touches of runs on all feet together.

    Returns:
        Of walks whose feet do not drag: `n_touches`, `found_share`, `n_in_air`, `n_twice` and the shares of these;
        `told_p50_ms` and `told_p99_ms`, from the first load to the sending, of those that are found;
        `dated_rms_ms`, the error of their times, and `dated_rms_over_sigma`; `wrong_share`, of the time in which the
        contact is another than the true one. Of slow loads: `n_slow_touches`, `slow_p95_ms`, the error of times of all
        that are told, and `n_slow_untold`. Of feet that drag: `n_dragged_touches` and `dragged_found_share`, told
        within `REPORT_AFTER_S` of their first load.
    """
    walked, slow, dragged = (
        [one.scores for one in judged if of_part(one.run.gait)]
        for of_part in (
            lambda gait: gait not in {SLOW, *DRAGGED},
            lambda gait: gait == SLOW,
            lambda gait: gait in DRAGGED,
        )
    )

    def listed(rows: list[dict[str, Any]], key: str) -> Any:
        return np.array([one for row in rows for one in row[key]] or [np.nan])

    def summed(rows: list[dict[str, Any]], key: str) -> int:
        return sum(row[key] for row in rows)

    errors_ms = listed(walked, "errors_ms")
    n_touches, n_dragged = summed(walked, "n_touches"), summed(dragged, "n_touches")
    return {
        "n_touches": n_touches,
        "found_share": 1.0 - summed(walked, "n_missed") / max(n_touches, 1),
        "n_in_air": summed(walked, "n_in_air"),
        "in_air_share": summed(walked, "n_in_air") / max(n_touches, 1),
        "n_twice": summed(walked, "n_twice"),
        "twice_share": summed(walked, "n_twice") / max(n_touches, 1),
        "told_p50_ms": float(np.percentile(listed(walked, "delays_ms"), 50)),
        "told_p99_ms": float(np.percentile(listed(walked, "delays_ms"), 99)),
        "dated_bias_ms": float(errors_ms.mean()),
        "dated_rms_ms": float(np.sqrt(np.mean(errors_ms**2))),
        "dated_rms_over_sigma": float(np.sqrt(np.mean((errors_ms / listed(walked, "sigmas_ms")) ** 2))),
        "wrong_share": float(np.mean([row["wrong_share"] for row in walked])) if walked else np.nan,
        "n_slow_touches": summed(slow, "n_touches"),
        "n_slow_untold": summed(slow, "n_missed"),
        "slow_p95_ms": float(np.percentile(np.abs(listed(slow, "errors_ms")), 95)),
        "n_dragged_touches": n_dragged,
        "dragged_found_share": 1.0 - summed(dragged, "n_missed") / max(n_dragged, 1),
    }


def pooled(judged: Sequence[JudgedRun]) -> dict[str, Any]:
    """Return the figures of all runs together: means, worst runs but landings, landings, and sums of events."""
    rows = [one.scores for one in judged]
    walking = [one.scores for one in judged if one.run.gait not in LANDINGS]
    landed = [one.scores for one in judged if one.run.gait in LANDINGS]

    def over(key: str, of: list[dict[str, Any]], how: Callable[[Any], Any]) -> float:
        known = np.array([row[key] for row in of], float)
        known = known[np.isfinite(known)]
        return float(how(known)) if known.size else float("nan")

    delays_ms, lifts_ms = (
        np.concatenate([np.array(row[key]) for row in rows]) for key in ("delays_ms", "lift_off_delays_ms")
    )
    figures: dict[str, Any] = {
        key: sum(row[key] for row in rows) for key in ("n_touches", "n_missed", "n_in_air", "n_twice")
    }
    for key in ("direction_deg", "mid_stance_deg"):
        figures |= {
            key: over(key, rows, np.mean),
            f"worst_{key}": over(key, walking, np.max),
            f"landings_{key}": over(key, landed, np.max),
        }
    return figures | {
        "no_force_share": over("no_force_share", walking, np.mean),
        "worst_no_force_share": over("no_force_share", walking, np.max),
        "least_within_2_sigma": over("within_2_sigma", rows, np.min),
        "most_beyond_5_sigma": over("beyond_5_sigma", rows, np.max),
        "n_off_by_peak": sum(row["n_off_by_peak"] for row in walking),
        "landings_n_off_by_peak": sum(row["n_off_by_peak"] for row in landed),
        "delay_p50_ms": float(np.percentile(delays_ms, 50)),
        "delay_p99_ms": float(np.percentile(delays_ms, 99)),
        "lift_off_delay_p50_ms": float(np.percentile(lifts_ms, 50, method="nearest")),
    }


def slip_figures(judged: Sequence[JudgedRun]) -> dict[str, Any]:
    """Return what became of the slides and slips of runs together.

    Returns:
        `n_slides` over `SLIDE_M` and `found_share`; `n_slips`, `false_share` of a foot that neither slides nor is at
        its cone, and `slow_share` of one that is slower than `SLIDE_M_S`; `told_p50_ms` after the begin of the slide;
        `minutes`; and `holds_bins`, how often the probability of holding was within each bounds, and how often such a
        foot held.
    """
    rows = [one.scores for one in judged]
    bins = np.sum([row["holds_bins"] for row in rows] or [np.zeros((len(HOLDS_BOUNDS) - 1, 2))], axis=0)
    n_slides, n_found, n_slips, n_false, n_slow = (
        sum(row[key] for row in rows)
        for key in ("n_slides", "n_slides_found", "n_slips", "n_false_slips", "n_slow_slips")
    )
    return {
        "n_slides": n_slides,
        "found_share": n_found / max(n_slides, 1),
        "n_slips": n_slips,
        "false_share": n_false / max(n_slips, 1),
        "slow_share": n_slow / max(n_slips, 1),
        "told_p50_ms": float(np.median([one for row in rows for one in row["slip_delays_ms"]] or [np.nan])),
        "minutes": float(sum(row["walked_s"] for row in rows) / 60.0),
        "holds_bins": bins.tolist(),
    }
