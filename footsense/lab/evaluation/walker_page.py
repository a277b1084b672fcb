"""Walking robots on a page of the report: rows, targets and text."""

import math
from typing import NamedTuple

from footsense.lab.evaluation.walker_judgement import LANDINGS, PAPER_PEAK_N, JudgedRun
from footsense.lab.evaluation.walker_scores import (
    AFTER_TOUCH_S,
    BEFORE_END_S,
    FIRST_LOAD_REL,
    LATER_S,
    LOADED_REL,
    MIN_TOUCH_S,
    NEAR_CONE,
    SLIDE_M,
    SLIDE_M_S,
)
from footsense.lab.report import Values, table, target


def row_of(one: JudgedRun) -> Values:
    """Return what the page says of one run; landings count apart."""
    kept = {key: value for key, value in one.scores.items() if not key.endswith("_ms") or "p" in key}
    for key in ("delays_ms", "errors_ms", "sigmas_ms", "lift_off_delays_ms", "slip_delays_ms"):
        kept.pop(key, None)
    return kept | {
        "run": one.run.name,
        "peak_n": one.peak_n,
        "is_landing": one.run.gait in LANDINGS,
        "bias_ms": one.scores["bias_ms"],
    }


class WalkerLimits(NamedTuple):
    """What is wanted of the paper's foot on walking robots.

    Attributes:
        direction_deg: Error of direction, mean over gaits and worst gait but landings [deg].
        mid_stance_deg: The same in mid-stance; the worst gait is infinite if nothing is wanted of it [deg].
        delay_ms: Median time from the first load to the sending of its touchdown [ms].
    """

    direction_deg: tuple[float, float] = (4.7, 8.0)
    mid_stance_deg: tuple[float, float] = (2.7, 5.5)
    delay_ms: float = 6.0


def walker_targets(own: Values, others: dict[str, Values], limits: WalkerLimits) -> list[dict[str, object]]:
    """Return the targets of walking robots; landings do not count in the worst gait and in time without a force."""

    def in_words(wanted_deg: tuple[float, float]) -> str:
        return " / ".join(f"{one:g}" for one in wanted_deg if one < math.inf) + " deg"

    touches = max(own["n_touches"], 1)
    low, high = own["rms_over_sigma"]
    hour = own["n_false_slips_gripping"] / max(own["gripping_hours"], 1e-9)
    rows = [
        target(
            "walking robots, direction, mean over gaits / worst gait but landings",
            in_words(limits.direction_deg),
            f"{own['direction_deg']:.1f} / {own['worst_direction_deg']:.1f} deg",
            met=own["direction_deg"] <= limits.direction_deg[0]
            and own["worst_direction_deg"] <= limits.direction_deg[1],
        ),
        target(
            "walking robots, direction in mid-stance, mean over gaits / worst gait but landings",
            in_words(limits.mid_stance_deg),
            f"{own['mid_stance_deg']:.1f} / {own['worst_mid_stance_deg']:.1f} deg",
            met=own["mid_stance_deg"] <= limits.mid_stance_deg[0]
            and own["worst_mid_stance_deg"] <= limits.mid_stance_deg[1],
        ),
        target(
            f"touchdowns of over {1e3 * MIN_TOUCH_S:g} ms found / in the air / twice, of {touches}",
            "99 % / 0 / 0",
            f"{1.0 - own['n_missed'] / touches:.1%} / {own['n_in_air']} / {own['n_twice']}",
            met=own["n_missed"] <= 0.01 * touches and own["n_in_air"] == own["n_twice"] == 0,
        ),
        target(
            "touchdown sent after the first load, median",
            f"{limits.delay_ms:g} ms",
            f"{own['delay_p50_ms']:.1f} ms",
            met=own["delay_p50_ms"] <= limits.delay_ms,
        ),
        target(
            "back-dating of touchdowns, worst bias of a gait; rms over sigma, least and most of a gait",
            "1 ms; 0.8 to 1.2",
            f"{own['worst_bias_ms']:.1f} ms; {low:.2f} to {high:.2f}",
            met=own["worst_bias_ms"] <= 1.0 and low >= 0.8 and high <= 1.2,
        ),
        target(
            "lift-off known after, median",
            "20 ms",
            f"{own['lift_off_delay_p50_ms']:.0f} ms",
            met=own["lift_off_delay_p50_ms"] <= 20.0,
        ),
        target(
            f"false slips an hour of walking, friction 0.8, of {60 * own['gripping_hours']:.0f} min",
            "1",
            f"{hour:.1f}",
            met=hour <= 1.0,
        ),
        target(
            f"slides that begin later, friction up to 0.3, found, of {own['n_later_slides']}",
            "60 %",
            f"{own['later_found_share']:.0%}",
            met=own["later_found_share"] >= 0.6,
        ),
        target(
            f"slips told of a foot that is not at its cone, of {own['n_slips']}",
            "0",
            f"{own['n_slips_off_cone']}",
            met=own["n_slips_off_cone"] == 0,
        ),
        target(
            "elements called faulty on healthy feet of walking robots",
            "0",
            f"{own['n_element_faults']}",
            met=own["n_element_faults"] == 0,
        ),
        target(
            "errors within 2 sigma / beyond 5 sigma, worst gait",
            "93 % / 0.3 %",
            f"{own['least_within_2_sigma']:.1%} / {own['most_beyond_5_sigma']:.2%}",
            met=own["least_within_2_sigma"] >= 0.93 and own["most_beyond_5_sigma"] <= 0.003,
        ),
        target(
            "usable forces of walking robots that are off by more than the peak load, but landings",
            "0",
            f"{own['n_off_by_peak']}",
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
    return rows


def walker_text(values: Values, page: str) -> str:
    """Return the section of walking robots on a page, whose name its pictures have."""
    force_head = (
        "robot, gait, ground | peak [N] | direction mean / 95 % below [deg] | mid-stance [deg] | first 40 ms [deg]"
        " | no force | overload | within 2 sigma | beyond 5"
    )
    force_cells = (
        "{run} | {peak_n:.3g} | {direction_deg:.1f} / {direction_p95_deg:.1f} | {mid_stance_deg:.1f} | {early_deg:.1f}"
        " | {no_force_share:.1%} | {overload_share:.1%} | {within_2_sigma:.1%} | {beyond_5_sigma:.2%}"
    )
    contact_head = (
        "robot, gait, ground | touches | missed / twice / in the air | sent after, median / 99 % [ms] | bias [ms]"
        " | rms over sigma | lift-off after, median / 95 % [ms] | slides later: found | slips: all / false / off the cone"
    )
    contact_cells = (
        "{run} | {n_touches} | {n_missed} / {n_twice} / {n_in_air} | {delay_p50_ms:.1f} / {delay_p99_ms:.1f}"
        " | {bias_ms:.1f} | {rms_over_sigma:.2f} | {lift_off_delay_p50_ms:.0f} / {lift_off_delay_p95_ms:.0f}"
        " | {n_later_found} of {n_later_slides} | {n_slips} / {n_false_slips} / {n_slips_off_cone}"
    )
    first, *others = values["runs"]
    own = values["pooled"][first]
    early = table(
        "robot, gait, ground | within 2 sigma, by 10 ms after the touch | beyond 5 sigma",
        [
            (
                row["run"],
                ", ".join(f"{100 * one:.0f}" for one in row["within_2_sigma_early"]) + " %",
                ", ".join(f"{100 * one:.1f}" for one in row["beyond_5_sigma_early"]) + " %",
            )
            for row in values["runs"][first]
            if row["n_touches"]
        ],
    )
    exact = table(
        "force | direction, mean over gaits / mid-stance [deg] | touches missed / twice / in the air"
        " | sent after, median / 99 % [ms] | worst bias of a gait [ms] | lift-off after, median [ms] | slides later: found"
        " | after, median [ms] | slips off the cone",
        {"estimated": own, "of a foot without mass": values["massless"], "true": values["exact"]},
        "{name} | {direction_deg:.1f} / {mid_stance_deg:.1f} | {n_missed} / {n_twice} / {n_in_air}"
        " | {delay_p50_ms:.1f} / {delay_p99_ms:.1f} | {worst_bias_ms:.1f}"
        " | {lift_off_delay_p50_ms:.0f} | {later_found_share:.0%} of {n_later_slides} | {slip_delay_p50_ms:.0f}"
        " | {n_slips_off_cone} of {n_slips}",
    )
    parts = [
        f"""Robots of a physics engine (`footsense/lab/walkers`): a hexapod of 2 kg and a quadruped of 12 kg, open-loop gaits with
joint PD, {len(values["runs"][first])} runs of 12 s. Robots, grounds and seeds of these runs are in no training and no choice of a threshold. The
whole estimation of the service runs on each conversion's readings, noise of the converter and the foot's own mass in
swing included; the response table that makes them is the network's. On `{first}` each run is scaled to a peak of
{PAPER_PEAK_N:g} N (one loaded millisecond in a thousand is above). A frame counts as loaded from {LOADED_REL:.0%} of the peak; mid-stance is from {1e3 * AFTER_TOUCH_S:g} ms
after the touch to {1e3 * BEFORE_END_S:g} ms before its end. A touch begins when the normal force exceeds {FIRST_LOAD_REL:.0%} of the peak. A slide counts
that goes over {1e3 * SLIDE_M:g} mm, as *later* if it begins more than {1e3 * LATER_S:g} ms after the touch. Slips are told of a foot at the cone of the
ground's coefficient, which is configured (`contact.friction`); without it none is told. A slip is *false* where the foot
does not slide faster than {1e3 * SLIDE_M_S:g} mm/s, *off the cone* where its true ratio is not within {NEAR_CONE:g} of the coefficient.

![The force that the first foot felt, and what was published, in each run]({page}-{first}.png)

{table(force_head, values["runs"][first], force_cells)}

{table(contact_head, values["runs"][first], contact_cells)}

{early}

The same without the foot's own mass, and with the true force of each conversion in place of the network's, whose only
error is then its age:

{exact}

Why contact and sigma miss what is wanted of them:

- Of {own["n_in_air"]} touchdowns in the air {own["n_in_air"] - own["n_in_air_walking"]} are in hops and landings, where the foot's own mass pulls at the
  sensor as much as a light robot loads it; of a foot without mass {values["massless"]["n_in_air"]} are told there. On the feet of the robots' own size, which weigh less beside their loads, there are {sum(values["pooled"][name]["n_in_air"] for name in others)}.
- In {own["n_almost_off"]} of the {own["n_twice"]} touches that are told twice the load falls below a twentieth of the peak in between.
- A touchdown is told from the second conversion that reads it: one reading of a load that has just begun is within the
  noise and the shake of swings.
- {own["beyond_5_sigma_sudden"]:.0%} of the errors beyond 5 sigma are where the force has changed by more than a tenth of the peak within two
  conversions before it is sent: no reading knows of that yet."""
    ]
    parts += [
        f"""### {name}, its own robot, real newtons

![The force that the first foot felt, and what was published, in each run]({page}-{name}.png)

{table(force_head, values["runs"][name], force_cells)}

{table(contact_head, values["runs"][name], contact_cells)}"""
        for name in others
    ]
    parts.append(
        f"""### Rubber that creeps and lags

Every fourth run on `{first}`, with the simulated rubber's creep and lag.

{table(force_head, values["creeping"], force_cells)}"""
    )
    return "\n\n".join(parts)
