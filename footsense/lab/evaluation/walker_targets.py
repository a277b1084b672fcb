"""What is wanted of forces, contacts and slips of walking robots, beside what was measured."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from footsense.lab.evaluation.walker_scores import MIN_TOUCH_S, SLIDE_M
from footsense.lab.report import Values, most_events, target, target_at_most

#: Slides over `SLIDE_M` that are wanted to be found, and false slips of all [1].
_SLIDES_FOUND, _SLIPS_FALSE = 0.8, 0.05


class WalkerLimits(NamedTuple):
    """What is wanted of the paper's foot on walking robots.

    Attributes:
        direction_deg: Error of direction, mean over gaits and worst gait but landings [deg].
        mid_stance_deg: The same in mid-stance; of the worst gait only where something is wanted of it [deg].
        shaking_deg: In mid-stance of loads that shake [deg]; NaN where nothing is wanted.
    """

    direction_deg: tuple[float, ...] = (4.7, 8.0)
    mid_stance_deg: tuple[float, ...] = (2.7, 5.5)
    shaking_deg: float = math.nan


class WantedContacts(NamedTuple):
    """What is wanted of the contacts of all feet in gaits that nothing was trained on, and of slow loads.

    Attributes:
        found_share: Touches that are found [1].
        in_air_share: Touchdowns in the air over the touches [1]: half of what commit 915c148e tells in the same
            gaits (158 and 143 of 3,342).
        twice_share: Touches that are told twice [1].
        told_ms: From the first load to the sending, median and 99 % [ms].
        slow_p95_ms: Error of the time of a slow load that 95 % are below [ms].
        dragged_share: Touches of feet that drag that are found [1].
        with_motion: Touches that are found, those in the air and those that are told twice where the motion of the legs
            is told [1].
        dated_rms_ms: Error of the time of a touch [ms, rms].
    """

    found_share: float
    in_air_share: float
    twice_share: float
    told_ms: tuple[float, float]
    slow_p95_ms: float
    dragged_share: float
    with_motion: tuple[float, float, float]
    dated_rms_ms: float = 4.0


def _touches_target(
    figure: str, found: Values, found_share: float, in_air_share: float, twice_share: float
) -> dict[str, object]:
    touches = max(found["n_touches"], 1)
    in_air = found["n_in_air"] / touches
    return target(
        f"touches of over {1e3 * MIN_TOUCH_S:g} ms, new gaits, {figure}: found / in the air / twice",
        f"{100 * found_share:.3g} % / {in_air_share:.1%} / {twice_share:.0%}",
        f"{found['found_share']:.1%} / {in_air:.1%} / {found['twice_share']:.1%} of {touches}",
        met=found["found_share"] >= found_share
        and in_air <= in_air_share
        and found["twice_share"] <= twice_share,
    )


def contact_targets(found: Values, with_motion: Values, wanted: WantedContacts) -> list[dict[str, object]]:
    """Return the targets of the contacts of all feet, from what `contact_figures` returns.

    Args:
        found: Figures of a robot that tells no motion of its legs.
        with_motion: Of one that does.
        wanted: What is wanted.
    """
    return [
        _touches_target("no motion told", found, wanted.found_share, wanted.in_air_share, wanted.twice_share),
        _touches_target("motion told", with_motion, *wanted.with_motion),
        target_at_most(
            "touches, new gaits, told after the first load, median / 99 %",
            wanted.told_ms,
            (found["told_p50_ms"], found["told_p99_ms"]),
            "{:.1f} / {:.1f} ms",
        ),
        target(
            "touches, new gaits, dated, rms; rms over sigma",
            f"{wanted.dated_rms_ms:g} ms; 0.8 to 1.2",
            f"{found['dated_rms_ms']:.1f} ms; {found['dated_rms_over_sigma']:.2f}",
            met=found["dated_rms_ms"] <= wanted.dated_rms_ms and 0.8 <= found["dated_rms_over_sigma"] <= 1.2,
        ),
        target_at_most(
            "slow loads dated, 95 % below",
            [wanted.slow_p95_ms],
            [found["slow_p95_ms"]],
            f"{{:.0f}} ms, {found['n_slow_untold']} of {found['n_slow_touches']} never told",
            "{:g} ms",
        ),
        target(
            "feet that drag, found at their first touch",
            f"{wanted.dragged_share:.0%}",
            f"{found['dragged_found_share']:.0%} of {found['n_dragged_touches']}",
            met=found["dragged_found_share"] >= wanted.dragged_share,
        ),
    ]


def slip_targets(found: Values) -> list[dict[str, object]]:
    """Return the targets of slips, from what `slip_figures` returns of all runs, on all feet."""
    return [
        target(
            f"slides over {1e3 * SLIDE_M:g} mm on all grounds, all feet, found",
            f"{_SLIDES_FOUND:.0%}",
            f"{found['found_share']:.0%} of {found['n_slides']}",
            met=found["found_share"] >= _SLIDES_FOUND,
        ),
        target(
            "slips told of a foot that neither slides nor is at its cone",
            f"{_SLIPS_FALSE:.0%}",
            f"{found['false_share']:.1%} of {found['n_slips']} in {60 * found['hours']:.0f} min",
            met=found["false_share"] <= _SLIPS_FALSE,
        ),
    ]


def walker_targets(
    own: Values, others: dict[str, Values], shaking: Sequence[Values], limits: WalkerLimits
) -> list[dict[str, object]]:
    """Return the targets of walking robots, on the paper's foot and on the others, and of loads that shake.

    Landings do not count in the worst gait, which is named beside theirs, and in time without a force. A rate of rare
    events is as high as its upper bound at 95 %.
    """
    most_faults_an_hour = most_events(own["n_element_faults"]) / max(own["walked_hours"], 1e-9)
    rows = [
        *(
            target(
                f"walking robots, {words}, mean over gaits / worst gait but landings; landings",
                " / ".join(f"{one:g}" for one in wanted_deg) + " deg",
                f"{own[key]:.1f} / {own[f'worst_{key}']:.1f} deg; {own[f'landings_{key}']:.1f} deg",
                met=all(
                    found <= wanted
                    for found, wanted in zip((own[key], own[f"worst_{key}"]), wanted_deg, strict=False)
                ),
            )
            for words, key, wanted_deg in (
                ("direction", "direction_deg", limits.direction_deg),
                ("direction in mid-stance", "mid_stance_deg", limits.mid_stance_deg),
            )
        ),
        target_at_most("lift-off known after, median", [20.0], [own["lift_off_delay_p50_ms"]], "{:.0f} ms"),
        target_at_most(
            "elements called faulty on healthy feet, an hour of walking, at most",
            [1.0],
            [most_faults_an_hour],
            f"{{:.0f}} ({own['n_element_faults']} in {60 * own['walked_hours']:.1f} min)",
            "{:g}",
        ),
        target(
            "errors within 2 sigma / beyond 5 sigma, worst gait",
            "93 % / 0.3 %",
            f"{own['least_within_2_sigma']:.1%} / {own['most_beyond_5_sigma']:.2%}",
            met=own["least_within_2_sigma"] >= 0.93 and own["most_beyond_5_sigma"] <= 0.003,
        ),
        target_at_most(
            "usable forces of walking robots that are off by more than the peak load, but landings; landings",
            [0],
            [own["n_off_by_peak"]],
            f"{{}}; {own['landings_n_off_by_peak']}",
            "{}",
        ),
    ]
    rows += [
        target(
            f"{name} on its robot, loaded time without a force, mean / worst gait but landings",
            "1 % in the worst gait",
            f"{found['no_force_share']:.1%} / {found['worst_no_force_share']:.1%}",
            met=found["worst_no_force_share"] <= 0.01,
        )
        for name, found in others.items()
    ]
    if not math.isnan(limits.shaking_deg):
        rows.append(
            target_at_most(
                f"loads that shake, direction in mid-stance, worst of {len(shaking)} feet",
                [limits.shaking_deg],
                [max(row["mid_stance_deg"] for row in shaking)],
                "{:.1f} deg",
            )
        )
    return rows
