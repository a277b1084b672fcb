"""What is wanted of each board on the page of motion, beside what was measured."""

from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from footsense.lab.evaluation.walker_scores import MIN_TOUCH_S, SLIDE_M
from footsense.lab.report import Values, target, target_at_most
from footsense.lab.studies.boards.many_feet import STEP_N
from footsense.strict_yaml import load


class _Wanted(Struct, forbid_unknown_fields=True):
    boards: dict[str, dict[str, tuple[float, ...]]]


#: What is wanted of each board, the default one first, and its file.
WANTED_FILE = Path(__file__).with_name("wanted.yaml")
WANTED = load(WANTED_FILE, _Wanted).boards
#: Wanted of both: errors within two sigma, of single loads and of the worst gait, and beyond five [1]; error of the
#: time of a touch [ms, rms]; slides over `SLIDE_M` that are found, and false slips of all [1].
_WITHIN_2_SIGMA, _BEYOND_5_SIGMA, _DATED_MS, _SLIDES_FOUND, _SLIPS_FALSE = 0.93, 0.003, 4.0, 0.8, 0.05
#: Loads of the network alone whose directions count, and whose errors have to be within two sigma.
_LOADS = ("random gaits", "measured walk", "tripod", "trot of a robot dog")


def board_targets(board: str, figures: Values) -> list[dict[str, object]]:
    """Return the targets of a board, from its figures on the page."""
    wanted = WANTED[board]
    by_load = {row["load"]: row for row in figures["gaits"]}
    step, missing, shaken = (figures[name] for name in ("step", "missing", "shaking"))

    def at_most(
        key: str, figure: str, found: Sequence[float], cells: str, limit: str | None = None
    ) -> list[dict[str, object]]:
        return [target_at_most(figure, wanted[key], found, cells, limit)] if key in wanted else []

    rows = [
        row
        for load in _LOADS
        for row in at_most(
            load.replace(" ", "_"),
            f"{load}, direction, mean / 95 % below",
            (by_load[load]["direction_deg"], by_load[load]["direction_p95_deg"]),
            "{:.2f} / {:.1f} deg",
        )
    ]
    rows += at_most("fz_mn", "measured walk, fz, rms", by_load["measured walk"]["rms_mn"][2:], "{:.1f} mN")
    rows += at_most(
        "settled_ms",
        f"step of 5 ms to {STEP_N:g} N, settled to 10 %, median / worst",
        (step["settled_p50_ms"], step["settled_worst_ms"]),
        "{:.1f} / {:.1f} ms",
    )
    rows += at_most(
        "missing_deg",
        "measured walk, an element / a row / a column missing, direction, mean over all of them",
        [missing[kind]["direction_deg"] for kind in ("element", "row", "column")],
        "{:.2f} / {:.2f} / {:.2f} deg",
    )
    rows.append(_least_within(figures))
    for place, (name, own) in enumerate(figures["own_robots"].items()):
        rows += at_most(
            f"own_{place}",
            f"{name}, whole service, direction / magnitude, mean",
            (own["direction_deg"], own["magnitude_rel"]),
            "{:.3f} deg / {:.2%}",
            "{:g} deg / {:.0%}",
        )
    rows += _walker_targets(wanted, figures["pooled"])
    rows += at_most(
        "shaking_deg",
        f"loads that shake, direction in mid-stance, worst of {len(shaken)} feet",
        [max(row["mid_stance_deg"] for row in shaken)],
        "{:.1f} deg",
    )
    return rows + _contact_targets(wanted, figures) + _slip_targets(figures["slips"]["all"])


def _least_within(figures: Values) -> dict[str, object]:
    within = {row["load"]: row["within_2_sigma"] for row in figures["gaits"] if row["load"] in _LOADS}
    within["step"] = figures["step"]["within_2_sigma"]
    within |= {f"{kind} missing": found["within_2_sigma"] for kind, found in figures["missing"].items()}
    least = min(within, key=lambda name: within[name])
    return target(
        "errors within 2 sigma, least of gaits, step and elements missing",
        f"{_WITHIN_2_SIGMA:.0%}",
        f"{within[least]:.1%} ({least})",
        met=within[least] >= _WITHIN_2_SIGMA,
    )


def _walker_targets(
    wanted: dict[str, tuple[float, ...]], pooled: dict[str, Values]
) -> list[dict[str, object]]:
    """Return the targets of walking robots, on the paper's foot and on the others.

    Landings do not count in the worst gait, which is named beside theirs, and in time without a force.
    """
    own, *others = pooled.values()
    rows = []
    for words, key in (("direction", "direction_deg"), ("direction in mid-stance", "mid_stance_deg")):
        found = own[key], own[f"worst_{key}"]
        rows.append(
            target_at_most(
                f"walking robots, {words}, mean over gaits / worst gait but landings; landings",
                wanted[key],
                found[: len(wanted[key])],
                f"{found[0]:.1f} / {found[1]:.1f} deg; {own[f'landings_{key}']:.1f} deg",
                " / ".join(["{:g}"] * len(wanted[key])) + " deg",
            )
        )
    rows += [
        target_at_most(
            "lift-off reported after, median", [20.0], [own["lift_off_delay_p50_ms"]], "{:.0f} ms"
        ),
        target(
            "errors within 2 sigma / beyond 5 sigma, worst gait",
            f"{100 * _WITHIN_2_SIGMA:g} % / {100 * _BEYOND_5_SIGMA:g} %",
            f"{own['least_within_2_sigma']:.1%} / {own['most_beyond_5_sigma']:.2%}",
            met=own["least_within_2_sigma"] >= _WITHIN_2_SIGMA
            and own["most_beyond_5_sigma"] <= _BEYOND_5_SIGMA,
        ),
        target_at_most(
            "usable forces off by more than the peak load, walking robots; landings",
            [0],
            [own["n_off_by_peak"]],
            f"{{}}; {own['landings_n_off_by_peak']}",
            "{}",
        ),
    ]
    return rows + [
        target(
            f"{name} on its robot, loaded time without a force, mean / worst gait but landings",
            "1 % in the worst gait",
            f"{found['no_force_share']:.1%} / {found['worst_no_force_share']:.1%}",
            met=found["worst_no_force_share"] <= 0.01,
        )
        for name, found in zip(list(pooled)[1:], others, strict=True)
    ]


def _contact_targets(wanted: dict[str, tuple[float, ...]], figures: Values) -> list[dict[str, object]]:
    found, with_motion = figures["contacts"], figures["contacts_with_motion"]
    (dragged,) = wanted["dragged"]
    return [
        _touches_target("without leg motion", found, *wanted["touches"]),
        _touches_target("with leg motion", with_motion, *wanted["touches_leg_motion"]),
        target_at_most(
            "touches, new gaits, reported after the first load, median / 99 %",
            wanted["told_ms"],
            (found["told_p50_ms"], found["told_p99_ms"]),
            "{:.1f} / {:.1f} ms",
        ),
        target(
            "touches, new gaits, error of the time, rms; rms over sigma",
            f"{_DATED_MS:g} ms; 0.8 to 1.2",
            f"{found['dated_rms_ms']:.1f} ms; {found['dated_rms_over_sigma']:.2f}",
            met=found["dated_rms_ms"] <= _DATED_MS and 0.8 <= found["dated_rms_over_sigma"] <= 1.2,
        ),
        target_at_most(
            "slow loads, error of the time, 95 % below",
            wanted["slow_ms"],
            [found["slow_p95_ms"]],
            f"{{:.0f}} ms, {found['n_slow_untold']} of {found['n_slow_touches']} never reported",
            "{:g} ms",
        ),
        target(
            "feet that drag, found at their first touch",
            f"{dragged:.0%}",
            f"{found['dragged_found_share']:.0%} of {found['n_dragged_touches']}",
            met=found["dragged_found_share"] >= dragged,
        ),
    ]


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


def _slip_targets(found: Values) -> list[dict[str, object]]:
    return [
        target(
            f"slides over {1e3 * SLIDE_M:g} mm on all grounds, all feet, found",
            f"{_SLIDES_FOUND:.0%}",
            f"{found['found_share']:.0%} of {found['n_slides']}",
            met=found["found_share"] >= _SLIDES_FOUND,
        ),
        target(
            "false slips: the foot neither slides nor is at its friction cone",
            f"{_SLIPS_FALSE:.0%}",
            f"{found['false_share']:.1%} of {found['n_slips']} in {60 * found['hours']:.0f} min",
            met=found["false_share"] <= _SLIPS_FALSE,
        ),
    ]
