"""Page `motion-rows`: the page `motion`, of board `fdc1004_columns`, that reads a row at once."""

import math

from footsense.lab.evaluation.walker_page import WalkerLimits
from footsense.lab.report import StudyContext, Values
from footsense.lab.studies.boards.page import BoardLimits
from footsense.lab.studies.motion import Wanted, compute_of, text_of

TITLE = "Force in motion of feet that read a row at once"

_WANTED = Wanted(
    BoardLimits(
        direction_deg={
            "random gaits": (0.9, 2.5),
            "measured walk": (0.45, 1.1),
            "tripod": (0.35, 0.8),
            "trot of a robot dog": (1.0, 3.0),
        },
        fz_mn=6.0,
        settled_ms=(22.0, 26.0),
        wrong_gains_deg=(1.8, 0.5),
        touchdown_ms=(3.0, 5.0, 1.5),
        missing_deg=(0.8, 1.5, 1.5),
        own_robots=((0.6, 0.01), (1.0, 0.02)),
    ),
    WalkerLimits(direction_deg=(2.4, 4.0), mid_stance_deg=(1.1, math.inf), delay_ms=3.0),
)


def compute(context: StudyContext) -> Values:
    """Judge the feet as on page `motion`, with the networks of board `fdc1004_columns`."""
    return compute_of(context, "rows", "motion-rows", _WANTED)


def text(values: Values) -> str:
    """Return the page's Markdown."""
    return f"""
Board `fdc1004_columns` converts a row of a foot at once: a scan takes three conversions in place of nine. The page is
that of [motion](motion.md), with the networks of this board; six legs on two buses, 40 us a transaction.
{text_of(values, "motion-rows")}"""
