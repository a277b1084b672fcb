"""What contact, slips and their thresholds are chosen by: the selection's robots and slow loads, on all feet."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from footsense.lab.evaluation.walker_judgement import (
    JudgedRun,
    JudgingLoads,
    contact_figures,
    judge,
    slip_figures,
)
from footsense.lab.evaluation.walker_runs import SCAN_TIMES, ToldMotion
from footsense.lab.report import Values, table
from footsense.lab.walkers.made_up import SLOW, MadeUpLoads
from footsense.lab.walkers.split import SELECTION, SLIPPERY_SELECTION

#: Slow loads of the selection.
_SLOW = (MadeUpLoads(SLOW, 5900, 14.0), MadeUpLoads(SLOW, 5901, 14.0))
_ROWS = {
    "touches of over 30 ms": "{n_touches}",
    "found": "{found_share:.1%}",
    "in the air": "{n_in_air}",
    "twice": "{n_twice} ({twice_share:.1%})",
    "told after the first load, median / 99 % [ms]": "{told_p50_ms:.1f} / {told_p99_ms:.1f}",
    "dated, bias / rms [ms]": "{dated_bias_ms:.1f} / {dated_rms_ms:.1f}",
    "dated, rms over sigma": "{dated_rms_over_sigma:.2f}",
    "sigma over error of forces told in the air, rms: least, median and most of the runs": (
        "{sigma[air][0]:.1f}, {sigma[air][1]:.1f}, {sigma[air][2]:.1f}"
    ),
    "the same in contact": "{sigma[contact][0]:.1f}, {sigma[contact][1]:.1f}, {sigma[contact][2]:.1f}",
    "contact wrong, share of the time": "{wrong_share:.1%}",
    "slow loads dated, 95 % [ms]; told": "{slow_p95_ms:.0f}; {n_slow_told} of {n_slow_touches}",
    "dragged feet found at their first touch": "{dragged_found_share:.0%} of {n_dragged_touches}",
    "slides over 5 mm found; slips: all, false": (
        "{slips[found_share]:.0%}; {slips[n_slips]}, {slips[false_share]:.1%}"
    ),
}


def select(
    models: Sequence[Path],
    *,
    runs: Sequence[JudgingLoads] = (*SELECTION, *_SLOW),
    slippery: Sequence[JudgingLoads] = SLIPPERY_SELECTION,
) -> dict[str, dict[str, Values]]:
    """Return the figures of contact and of slips by board, then by foot type, the last two for all feet.

    Args:
        models: Folders of the foot types, the paper's first.
        runs: The runs.
        slippery: Runs for slips alone.
    """
    figures: dict[str, dict[str, Values]] = {}
    for board in SCAN_TIMES:
        judged, slipping = judge(models, runs, board), judge(models, slippery, board)
        told = judge(models, runs, board, ToldMotion())
        figures[board] = {
            folder.name: _figures(
                [one for one in judged if one.foot_type == folder.name],
                [one for one in slipping if one.foot_type == folder.name],
            )
            for folder in models
        } | {"all": _figures(judged, slipping), "all, motion of the legs told": _figures(told, [])}
    return figures


def _figures(judged: Sequence[JudgedRun], slipping: Sequence[JudgedRun]) -> Values:
    walked = [one for one in judged if one.run.gait != SLOW]
    sigma = {
        phase: np.nanpercentile(
            [one.scores["sigma_over_error"][phase] for one in walked], (0, 50, 100)
        ).tolist()
        for phase in ("air", "contact")
    }
    return contact_figures(judged) | {"slips": slip_figures([*walked, *slipping]), "sigma": sigma}


def as_markdown(figures: dict[str, dict[str, Values]]) -> str:
    """Return the table of the figures of `select`."""
    columns = {
        f"`{board}` {foot}": values | {"n_slow_told": values["n_slow_touches"] - values["n_slow_untold"]}
        for board, by_foot in figures.items()
        for foot, values in by_foot.items()
    }
    rows = [(name, *map(partial(str.format_map, form), columns.values())) for name, form in _ROWS.items()]
    return table(" | ".join(["selection", *columns]), rows)
