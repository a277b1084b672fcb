"""Walking robots on a page of the report: rows, targets and text."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from footsense.lab.evaluation.walker_judgement import LANDINGS, JudgedRun
from footsense.lab.evaluation.walker_runs import ToldMotion
from footsense.lab.evaluation.walker_scores import (
    AFTER_TOUCH_S,
    AT_CONE_REL,
    BEFORE_END_S,
    FIRST_LOAD_REL,
    HOLDS_BOUNDS,
    LOADED_REL,
    MIN_TOUCH_S,
    REPORT_AFTER_S,
    SLIDE_M,
    SLIDE_M_S,
)
from footsense.lab.report import SAME_TABLE, Values, most_events, table, table_by_board, target
from footsense.lab.walkers.slow_loads import RISE_S, SWING_S


def row_of(one: JudgedRun) -> Values:
    """Return what the page says of one run; landings count apart."""
    kept = {key: value for key, value in one.scores.items() if not key.endswith("_ms") or "p" in key}
    for key in (
        *("delays_ms", "errors_ms", "sigmas_ms", "lift_off_delays_ms"),
        *("slip_delays_ms", "supposed", "holds_bins"),
    ):
        kept.pop(key, None)
    return kept | {
        "run": one.run.name,
        "foot_type": one.foot_type,
        "peak_n": one.peak_n,
        "is_landing": one.run.gait in LANDINGS,
        "bias_ms": one.scores["bias_ms"],
    }


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
        in_air_share: Touchdowns in the air over the touches [1]: half of what commit 915c148e tells in the same gaits (158 and 143 of
            3,342).
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
        target(
            "touches, new gaits, told after the first load, median / 99 %",
            f"{wanted.told_ms[0]:g} / {wanted.told_ms[1]:g} ms",
            f"{found['told_p50_ms']:.1f} / {found['told_p99_ms']:.1f} ms",
            met=found["told_p50_ms"] <= wanted.told_ms[0] and found["told_p99_ms"] <= wanted.told_ms[1],
        ),
        target(
            "touches, new gaits, dated, rms; rms over sigma",
            f"{wanted.dated_rms_ms:g} ms; 0.8 to 1.2",
            f"{found['dated_rms_ms']:.1f} ms; {found['dated_rms_over_sigma']:.2f}",
            met=found["dated_rms_ms"] <= wanted.dated_rms_ms and 0.8 <= found["dated_rms_over_sigma"] <= 1.2,
        ),
        target(
            "slow loads dated, 95 % below",
            f"{wanted.slow_p95_ms:g} ms",
            f"{found['slow_p95_ms']:.0f} ms, {found['n_slow_untold']} of {found['n_slow_touches']} never told",
            met=found["slow_p95_ms"] <= wanted.slow_p95_ms,
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


def slip_text(boards: Mapping[str, Values]) -> str:
    """Return the section of slides and slips on a page, from the figures of each board."""
    by_part = table_by_board(
        f"walked, {SAME_TABLE}: {{part}}, {{minutes:.1f}} min",
        {
            board: [
                figures | {"part": part, "minutes": 60 * figures["hours"]}
                for part, figures in of_board["slips"].items()
            ]
            for board, of_board in boards.items()
        },
        _SLIPS,
    )
    supposed = table_by_board(
        f"what is known of the ground, {SAME_TABLE}: {{part}}",
        {
            board: [
                of_board["slips"]["all"] | {"part": "friction known"},
                *(one | {"part": part} for part, one in of_board["slips"]["all"]["supposed"].items()),
            ]
            for board, of_board in boards.items()
        },
        _SLIPS,
    )
    holds = table(
        f"probability of holding, {SAME_TABLE} | " + " | ".join(f"held, `{board}`" for board in boards),
        [
            (
                f"{low:g} to {high:g}",
                *(
                    f"{held / max(n, 1):.2f} of {n}"
                    for of_board in boards.values()
                    for n, held in (of_board["slips"]["all"]["holds_bins"][number],)
                ),
            )
            for number, (low, high) in enumerate(pairwise(HOLDS_BOUNDS))
        ],
    )
    return f"""## Feet that slide

All of these runs, on all feet, the ground's friction configured (`contact.friction`). A slide counts that is faster than
{1e3 * SLIDE_M_S:g} mm/s for {1e3 * SLIDE_M:g} mm. A slip is *false* where the foot neither is as fast nor at its cone: there a true ratio is above
{AT_CONE_REL:.0%} of the friction, and a foot slides at any speed; the last share is of all that are slower.

{by_part}

{supposed}

How often a foot held of which it was said with such a probability:

{holds}
"""


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
        target(
            "lift-off known after, median",
            "20 ms",
            f"{own['lift_off_delay_p50_ms']:.0f} ms",
            met=own["lift_off_delay_p50_ms"] <= 20.0,
        ),
        target(
            "elements called faulty on healthy feet, an hour of walking, at most",
            "1",
            f"{most_faults_an_hour:.0f} ({own['n_element_faults']} in {60 * own['walked_hours']:.1f} min)",
            met=most_faults_an_hour <= 1.0,
        ),
        target(
            "errors within 2 sigma / beyond 5 sigma, worst gait",
            "93 % / 0.3 %",
            f"{own['least_within_2_sigma']:.1%} / {own['most_beyond_5_sigma']:.2%}",
            met=own["least_within_2_sigma"] >= 0.93 and own["most_beyond_5_sigma"] <= 0.003,
        ),
        target(
            "usable forces of walking robots that are off by more than the peak load, but landings; landings",
            "0",
            f"{own['n_off_by_peak']}; {own['landings_n_off_by_peak']}",
            met=own["n_off_by_peak"] == 0,
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
        worst_deg = max(row["mid_stance_deg"] for row in shaking)
        rows.append(
            target(
                f"loads that shake, direction in mid-stance, worst of {len(shaking)} feet",
                f"{limits.shaking_deg:g} deg",
                f"{worst_deg:.1f} deg",
                met=worst_deg <= limits.shaking_deg,
            )
        )
    return rows


_FORCES = {
    "direction mean / 95 % below [deg]": "{direction_deg:.1f} / {direction_p95_deg:.1f}",
    "mid-stance [deg]": "{mid_stance_deg:.1f}",
    "no force / overload": "{no_force_share:.1%} / {overload_share:.1%}",
    "within 2 sigma / beyond 5": "{within_2_sigma:.1%} / {beyond_5_sigma:.2%}",
}
_CONTACTS = {
    "missed / twice / in the air": "{n_missed} / {n_twice} / {n_in_air}",
    "sent after, median / 99 % [ms]": "{delay_p50_ms:.1f} / {delay_p99_ms:.1f}",
    "bias [ms]; rms over sigma": "{bias_ms:.1f}; {rms_over_sigma:.2f}",
    "slides: found": "{n_slides_found} of {n_slides}",
    "slips: all / false": "{n_slips} / {n_false_slips}",
}
_NEW_CONTACTS = {
    "missed / twice / in the air": "{n_missed} / {n_twice} / {n_in_air}",
    "sent after, median / 99 % [ms]": "{delay_p50_ms:.1f} / {delay_p99_ms:.1f}",
    "bias [ms]; rms over sigma": "{bias_ms:.1f}; {rms_over_sigma:.2f}",
    "contact wrong": "{wrong_share:.1%}",
}
_POOLED = {
    "direction, mean / mid-stance [deg]": "{direction_deg:.1f} / {mid_stance_deg:.1f}",
    "touches missed / twice / in the air": "{n_missed} / {n_twice} / {n_in_air}",
    "sent after, median / 99 % [ms]": "{delay_p50_ms:.1f} / {delay_p99_ms:.1f}",
    "worst bias [ms]": "{worst_bias_ms:.1f}",
    "lift-off after, median [ms]": "{lift_off_delay_p50_ms:.0f}",
    "slides: found": "{slips[found_share]:.0%} of {slips[n_slides]}",
}
_SLIPS = {
    f"slides over {1e3 * SLIDE_M:g} mm: found": "{found_share:.0%} of {n_slides}",
    "told after the begin, median [ms]": "{told_p50_ms:.0f}",
    f"slips: all / false / below {1e3 * SLIDE_M_S:g} mm/s": "{n_slips} / {false_share:.1%} / {slow_share:.1%}",
}
#: Slides over `SLIDE_M` that are wanted to be found, and false slips of all [1].
_SLIDES_FOUND, _SLIPS_FALSE = 0.8, 0.05


def _forces_table(rows: Mapping[str, Sequence[Values]]) -> str:
    return table_by_board(
        f"robot, gait, ground, peak, {SAME_TABLE}: {{run}}, {{peak_n:.3g}} N", rows, _FORCES
    )


def _contacts_table(rows: Mapping[str, Sequence[Values]]) -> str:
    return table_by_board(
        f"robot, gait, ground, touches, {SAME_TABLE}: {{run}}, {{n_touches}}", rows, _CONTACTS
    )


def _told_table(boards: Mapping[str, Values]) -> str:
    return table_by_board(
        f"all touches, {SAME_TABLE}: {{motion}}, {{n_touches}}",
        {
            board: [
                {"motion": "no motion told"} | of_board["contacts"],
                {"motion": "motion told"} | of_board["contacts_with_motion"],
            ]
            for board, of_board in boards.items()
        },
        {
            "found": "{found_share:.1%}",
            "in the air / twice": "{n_in_air} / {n_twice}",
            "told, median / 99 % [ms]": "{told_p50_ms:.1f} / {told_p99_ms:.1f}",
            "dated, rms [ms] / over sigma": "{dated_rms_ms:.1f} / {dated_rms_over_sigma:.2f}",
            "contact wrong": "{wrong_share:.1%}",
        },
    )


def contact_text(boards: Mapping[str, Values]) -> str:
    """Return the section of contacts in new gaits on a page, from the figures of each board."""
    new = {board: of_board["new_runs"] for board, of_board in boards.items()}
    return f"""## Contact in gaits that nothing was trained on

The same two robots in gaits of which each has another order of footfalls than all of training and selection, or a duty
that differs by more than 0.1, or starts, stops and turns; {len(next(iter(new.values())))} runs of a robot on a foot, on the
paper's foot scaled to half of its range, and on the robot's own. A touch begins when the normal force exceeds
{FIRST_LOAD_REL:.0%} of the peak, by loads at a thousand a second, and is found if it is told within {1e3 * REPORT_AFTER_S:g} ms; it counts
after {1e3 * MIN_TOUCH_S:g} ms in the air if it lasts as long. Feet of gaits with *drag* are lifted so little that they are loaded by
a few percent of a stance's load for part of their swing. Beside them walks a Unitree Aliengo under a learned policy in a
closed loop, whose log comes with its source (`lab/walkers/logs`). Slow loads are made up (`lab/walkers/slow_loads.py`): six
feet whose loads rise within {RISE_S[0]:g} to {RISE_S[1]:g} s, wait on plateaus and ripple, after swings of {SWING_S[0]:g} to {SWING_S[1]:g} s;
their error counts however late they are told. Where the motion of the legs is told, it is once in {1e3 * ToldMotion().period_s:g} ms and {1e3 * ToldMotion().late_s:g} ms late.

{_told_table(boards)}

{table_by_board(f"foot, gait, ground, touches, {SAME_TABLE}: {{foot_type}}, {{run}}, {{n_touches}}", new, _NEW_CONTACTS)}
"""


def walker_text(boards: Mapping[str, Values], page: str) -> str:
    """Return the section of walking robots on a page, from the figures of each board.

    Args:
        boards: The figures.
        page: Its name, which its pictures have.
    """
    values = next(iter(boards.values()))
    first, *others = values["runs"]
    early = table_by_board(
        f"robot, gait, ground, {SAME_TABLE}: {{run}}",
        {
            board: [
                {
                    "run": row["run"],
                    "within": ", ".join(f"{100 * one:.0f}" for one in row["within_2_sigma_early"]),
                    "beyond": ", ".join(f"{100 * one:.1f}" for one in row["beyond_5_sigma_early"]),
                }
                for row in of_board["runs"][first]
                if row["n_touches"]
            ]
            for board, of_board in boards.items()
        },
        {"within 2 sigma, by 10 ms after the touch [%]": "{within}", "beyond 5 [%]": "{beyond}"},
    )
    exact = table_by_board(
        f"force, {SAME_TABLE}: {{name}}",
        {
            board: [
                {"name": "estimated"} | of_board["pooled"][first],
                {"name": "of a foot without mass"} | of_board["massless"],
                {"name": "true"} | of_board["exact"],
            ]
            for board, of_board in boards.items()
        },
        _POOLED,
    )
    why = table(
        f"board, {SAME_TABLE} | in the air: all / in hops and landings / of a foot without mass / on the larger feet"
        " | twice: all / load below a twentieth of the peak in between | beyond 5 sigma: within two conversions of a"
        " change by a tenth of the peak",
        [
            (
                f"`{board}`",
                " / ".join(
                    map(
                        str,
                        (
                            own["n_in_air"],
                            own["n_in_air"] - own["n_in_air_walking"],
                            of_board["massless"]["n_in_air"],
                            sum(of_board["pooled"][name]["n_in_air"] for name in others),
                        ),
                    )
                ),
                f"{own['n_twice']} / {own['n_almost_off']}",
                f"{own['beyond_5_sigma_sudden']:.0%}",
            )
            for board, of_board in boards.items()
            for own in (of_board["pooled"][first],)
        ],
    )
    parts = [
        f"""Robots of a physics engine (`footsense/lab/walkers`): a hexapod of 2 kg and a quadruped of 12 kg, open-loop gaits with
joint PD, {len(values["runs"][first])} runs of 12 s. Robots, grounds and seeds of these runs are in no training and no choice of a threshold. The
whole estimation of the service runs on each conversion's readings, noise of the converter and the foot's own mass in
swing included; the response table that makes them is the network's. On `{first}` each run is scaled to a peak of
1 N (one loaded millisecond in a thousand is above). A frame counts as loaded from {LOADED_REL:.0%} of the peak; mid-stance is from {1e3 * AFTER_TOUCH_S:g} ms
after the touch to {1e3 * BEFORE_END_S:g} ms before its end. A touch begins when the normal force exceeds {FIRST_LOAD_REL:.0%} of the peak.

{_pictures(boards, page, first)}

{_forces_table({board: of_board["runs"][first] for board, of_board in boards.items()})}

{_contacts_table({board: of_board["runs"][first] for board, of_board in boards.items()})}

{early}

The same without the foot's own mass, and with the true force of each conversion in place of the network's, whose only
error is then its age:

{exact}

Where contact and sigma miss what is wanted of them: the foot's own mass pulls at the sensor as much as a light robot
loads it; a touchdown is told from the second conversion that reads it, as one reading of a load that has just begun is
within the noise and the shake of swings; and no reading knows yet of what changes within two conversions.

{why}"""
    ]
    parts += [
        f"""### {name}, its own robot, real newtons

{_pictures(boards, page, name)}

{_forces_table({board: of_board["runs"][name] for board, of_board in boards.items()})}

{_contacts_table({board: of_board["runs"][name] for board, of_board in boards.items()})}"""
        for name in others
    ]
    parts.append(
        f"""### Loads that shake

Made up (`lab/walkers/shaking_loads.py`), as those of a robot under a learned policy: a quarter of the power of the
tangential force in mid-stance is above 40 Hz, the contact rolls at 140 deg/s, in strides of 0.35 to 0.7 s.

{table_by_board(f"foot, {SAME_TABLE}: {{foot_type}}", {board: of_board["shaking"] for board, of_board in boards.items()}, _FORCES)}"""
    )
    parts.append(
        f"""### Rubber that creeps and lags

Every fourth run on `{first}`, with the simulated rubber's creep and lag.

{_forces_table({board: of_board["creeping"] for board, of_board in boards.items()})}"""
    )
    return "\n\n".join(parts)


def _pictures(boards: Mapping[str, Values], page: str, foot_type: str) -> str:
    return "\n\n".join(
        f"![The force that the first foot felt, and what was published, in each run, board {board}]"
        f"({page}-{board}-{foot_type}.png)"
        for board in boards
    )
