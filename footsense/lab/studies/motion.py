"""Page `motion`: forces of feet that move, what a gait controller is told of them, and when."""

from functools import partial

import numpy as np

from footsense.daemon.foot_types import released_path
from footsense.estimation.missing_elements import Imputation
from footsense.foot.directions import angles_between_deg
from footsense.frames import ELEMENTS, LEGS, Mask, Vector
from footsense.lab.evaluation.walker_judgement import (
    LANDINGS,
    PAPER_PEAK_N,
    JudgedRun,
    draw,
    judge,
    pooled,
)
from footsense.lab.evaluation.walker_scores import (
    AFTER_TOUCH_S,
    BEFORE_END_S,
    FIRST_LOAD_REL,
    LATER_S,
    LOADED_REL,
    MIN_TOUCH_S,
    SLIDE_M,
)
from footsense.lab.foot_file import FOOT_FILE
from footsense.lab.report import StudyContext, Values, spread, table, target
from footsense.lab.training.gait_readings import (
    STEP_S,
    GaitReadings,
    ReadingConditions,
    concatenate_gaits,
    loads_of,
    random_gaits,
    select_gaits,
    simulate_gait_readings,
)
from footsense.lab.training.gait_windows import (
    contact_and_normal_force,
    estimate_in_batches,
    normals_of_stereographic_points,
    windows_of,
)
from footsense.lab.walkers.split import JUDGEMENT
from footsense.ports import Window
from footsense.sim.loads.ground_load import ContactSource
from footsense.sim.loads.walk import Walk, measured_walk, smooth_stance_reaction

TITLE = "Force in motion, and what a gait controller is told"

#: Seed of the gaits that judge; training uses another.
_SEED = 990_001
_N_GAITS, _CONVERSIONS, _WALK_CONVERSIONS = 200, 1100, 2500
#: A conversion counts as usual if its time is within this of 400 a second [1].
_USUAL_RATE_REL = 0.05
#: Least force of a direction, of a friction ratio, and least normal force of a contact normal [N].
_DIRECTION_N, _FRICTION_N, _NORMAL_N = 0.1, 0.3, 0.5
_WALK_START_NS = 200_000_000
_NOTHING = np.zeros(ELEMENTS, bool)
#: Standard deviations of wrong gains [1], and draws of a foot's nine gains.
_GAIN_ERRORS_REL, _N_DRAWS = (0.003, 0.01, 0.03), 20
#: Released feet beside the paper's, judged by their own robots at real newtons.
_OWN_ROBOTS = ("hexapod-2kg", "quadruped-12kg")
#: Runs of a quick page.
_QUICK_RUNS = slice(1, None, 12)


def compute(context: StudyContext) -> Values:
    """Judge the feet by walking robots; estimate the force in random gaits and walks."""
    gaits, wrong_gains = _gaits(context)
    context.report_progress("gaits done")
    folders = [context.models, *(released_path(FOOT_FILE, name).parent for name in _OWN_ROBOTS)]
    runs = JUDGEMENT[_QUICK_RUNS] if context.quick else JUDGEMENT
    judged = judge(folders, runs, scheduler=context.scheduler)
    context.report_progress("walking robots done")
    own_type = context.foot_design.foot_type
    by_foot = {
        name: [one for one in judged if one.foot_type == name]
        for name in dict.fromkeys(one.foot_type for one in judged)
    }
    for name, runs_of_foot in by_foot.items():
        context.drawings[f"motion-{name}.png"] = draw(runs_of_foot, name)
    creeping = judge(folders[:1], runs[::4], viscous_rel=1.0, scheduler=context.scheduler)
    together = {name: pooled(runs_of_foot) for name, runs_of_foot in by_foot.items()}
    walk = next(row for row in gaits if row["load"] == "measured walk")
    return {
        "n_random_gaits": 6 if context.quick else _N_GAITS,
        "gaits": gaits,
        "wrong_gains": wrong_gains,
        "runs": {name: [_row(one) for one in runs_of_foot] for name, runs_of_foot in by_foot.items()},
        "pooled": together,
        "creeping": [_row(one) for one in creeping],
        "targets": [
            target(
                "measured walk, direction, mean / 95 % below (one walk, two legs)",
                "0.8 / 3 deg",
                f"{walk['direction_deg']:.1f} / {walk['direction_p95_deg']:.1f} deg",
                met=walk["direction_deg"] <= 0.8 and walk["direction_p95_deg"] <= 3.0,
            ),
            *_walker_targets(
                together[own_type], {name: together[name] for name in together if name != own_type}
            ),
        ],
    }


def _row(one: JudgedRun) -> Values:
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


def _walker_targets(own: Values, others: dict[str, Values]) -> list[dict[str, object]]:
    """Return the targets of walking robots; landings do not count in the worst gait and in time without a force."""
    touches = max(own["n_touches"], 1)
    low, high = own["rms_over_sigma"]
    hour = own["n_false_slips_gripping"] / max(own["gripping_hours"], 1e-9)
    rows = [
        target(
            "walking robots, direction, mean over gaits / worst gait but landings",
            "4.7 / 8 deg",
            f"{own['direction_deg']:.1f} / {own['worst_direction_deg']:.1f} deg",
            met=own["direction_deg"] <= 4.7 and own["worst_direction_deg"] <= 8.0,
        ),
        target(
            "walking robots, direction in mid-stance, mean over gaits / worst gait but landings",
            "2.7 / 5.5 deg",
            f"{own['mid_stance_deg']:.1f} / {own['worst_mid_stance_deg']:.1f} deg",
            met=own["mid_stance_deg"] <= 2.7 and own["worst_mid_stance_deg"] <= 5.5,
        ),
        target(
            f"touchdowns of over {1e3 * MIN_TOUCH_S:g} ms found / in the air / twice, of {touches}",
            "99 % / 0 / 0",
            f"{1.0 - own['n_missed'] / touches:.1%} / {own['n_in_air']} / {own['n_twice']}",
            met=own["n_missed"] <= 0.01 * touches and own["n_in_air"] == own["n_twice"] == 0,
        ),
        target(
            "touchdown sent after the first load, median",
            "6 ms",
            f"{own['delay_p50_ms']:.1f} ms",
            met=own["delay_p50_ms"] <= 6.0,
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


def _walked(
    context: StudyContext, source: ContactSource, legs: tuple[str, ...], viscous_rel: float = 0.0
) -> GaitReadings:
    n = 400 if context.quick else _WALK_CONVERSIONS
    conditions = ReadingConditions(viscous_rel=viscous_rel)
    return concatenate_gaits(
        [
            simulate_gait_readings(
                context.response, loads_of(source, leg), conditions, np.random.default_rng((_SEED, row)), n
            )
            for row, leg in enumerate(legs)
        ]
    )


def _gaits(context: StudyContext) -> tuple[list[Values], Values]:
    """Return the errors in gaits and walks, and those of direction with wrong gains, draw by draw [deg]."""
    n_gaits = 6 if context.quick else _N_GAITS
    max_n = context.foot_design.loads.max_n
    random = random_gaits(context.response, _SEED, n_gaits, _CONVERSIONS, max_n)
    at_usual_pace = (random.conversion_order_index == 0) & (
        np.abs(random.step_s / STEP_S - 1.0) < _USUAL_RATE_REL
    )
    usual = select_gaits(random, at_usual_pace)
    walk = measured_walk(1.0, 10.0, _WALK_START_NS)
    tripod = Walk(
        dict.fromkeys(LEGS, smooth_stance_reaction(0.6, 1.0, 0.15)),
        period_ns=1_200_000_000,
        duty_rel=0.6,
        pitch_deg=10.0,
        from_ns=_WALK_START_NS,
    )
    sides = ("rf", "lf")
    walked = _walked(context, walk, sides)
    middle, row = np.arange(ELEMENTS) == 4, np.arange(ELEMENTS) < 3
    errors = partial(_errors, context)
    rows = [
        errors("random gaits", usual),
        errors("random gaits at another pace", select_gaits(random, ~at_usual_pace)),
        errors("measured walk", walked),
        errors("tripod", _walked(context, tripod, ("rf",))),
        errors("walk, rubber creeps and lags", _walked(context, walk, sides, viscous_rel=1.0)),
        errors("walk, middle element missing", walked, missing=middle),
        errors("walk, row 0 missing", walked, missing=row),
    ]
    wrong = {}
    for gain_rel in _GAIN_ERRORS_REL:
        draws = [
            errors("", walked, gain=1.0 + gain_rel * np.random.default_rng(draw).normal(size=(2, ELEMENTS)))
            for draw in range(2 if context.quick else _N_DRAWS)
        ]
        wrong[f"{100 * gain_rel:g} %"] = {
            key: [draw[key] for draw in draws] for key in ("direction_deg", "within_2_sigma")
        }
    return rows, wrong


def _errors(
    context: StudyContext,
    load: str,
    gaits: GaitReadings,
    missing: Mask = _NOTHING,
    gain: Vector | None = None,
) -> Values:
    """Return the errors of the network over all windows of gaits, elements missing or with gains of each gait's foot."""
    windows = windows_of(gaits)
    closure_rel, force_n, normal = windows.closure_rel, windows.force_n, windows.normal
    if gain is not None:
        closure_rel = closure_rel * gain[windows.gait][:, None]
    closure_rel = closure_rel @ Imputation(context.trained_inputs.moments).matrix(missing).T
    found = estimate_in_batches(
        context.network, Window(closure_rel, windows.age_s, np.tile(missing, (len(closure_rel), 1)))
    )
    loaded = np.linalg.norm(force_n, axis=1) > _DIRECTION_N
    error_n = (found.force_n - force_n)[loaded]
    off = np.abs(error_n / found.sigma_n[loaded])
    direction_deg = angles_between_deg(found.force_n[loaded], force_n[loaded])
    true_contact, pressing_n = contact_and_normal_force(force_n, normal)
    firm, firmer = pressing_n > _FRICTION_N, pressing_n > _NORMAL_N
    found_normal = normals_of_stereographic_points(found.contact_point_and_friction[:, :2])
    friction = _friction_ratio(found.contact_point_and_friction[:, 2:], found_normal) - _friction_ratio(
        true_contact[:, 2:], normal
    )
    return {
        "load": load,
        "direction_deg": direction_deg.mean(),
        "direction_p95_deg": np.percentile(direction_deg, 95),
        "rms_mn": 1e3 * np.sqrt((error_n**2).mean(axis=0)),
        "within_2_sigma": (off < 2.0).mean(),
        "beyond_5_sigma": (off > 5.0).mean(),
        "friction_error": np.abs(friction[firm]).mean(),
        "normal_error_deg": angles_between_deg(found_normal[firmer], normal[firmer]).mean(),
    }


def _friction_ratio(ratio: Vector, normal: Vector) -> Vector:
    """Return tangential over normal force [1], shape (n,), from in-plane components, shape (n, 2)."""
    along = (normal[:, :2] * ratio).sum(axis=1) / normal[:, 2]
    friction_ratio: Vector = np.sqrt((ratio**2).sum(axis=1) + along**2)
    return friction_ratio


def text(values: Values) -> str:
    """Return the page's Markdown."""
    gaits = table(
        "load | direction mean / 95 % below [deg] | fx / fy / fz rms [mN] | within 2 sigma | beyond 5 | friction ratio"
        " | normal [deg]",
        values["gaits"],
        "{load} | {direction_deg:.2f} / {direction_p95_deg:.1f} | {rms_mn[0]:.0f} / {rms_mn[1]:.0f} / {rms_mn[2]:.0f}"
        " | {within_2_sigma:.1%} | {beyond_5_sigma:.2%} | {friction_error:.4f} | {normal_error_deg:.2f}",
    )
    gains = table(
        "gains off by, standard deviation | direction, mean of a draw [deg] | within 2 sigma, mean of the draws",
        [
            (gain, spread(found["direction_deg"]), f"{np.mean(found['within_2_sigma']):.0%}")
            for gain, found in values["wrong_gains"].items()
        ],
    )
    n_draws = len(next(iter(values["wrong_gains"].values()))["direction_deg"])
    return f"""
The released network on gaits that it was not trained on: {values["n_random_gaits"]} random gaits of another seed (stances of 60 ms to 2 s
that rise in 5 to 150 ms; scans of 4.5 to 125 ms in the row of another pace), the measured walk of two legs, and a
tripod of one, all at 1 N peak but the random ones. The force is that at the time of sending. Directions count from
{_DIRECTION_N} N on, friction from {_FRICTION_N} N, the contact's normal from {_NORMAL_N} N of normal force. Readings come from the response
table that the network was trained on, with the converter's noise and timing: the model that is judged made them. The
whole service against simulated chips is the row *nothing* of the [faults](faults.md).

{gaits}

## Wrong gains

Each draw is a walk on two feet whose elements are off by random gains; {n_draws} draws. Gains that are off turn the force in
a way that no window of readings can tell: a foot's own gains come from its calibration, and what they leave open is
added to sigma there.

{gains}

## Walking robots

{_walker_text(values)}
"""


def _walker_text(values: Values) -> str:
    """Return the section of walking robots."""
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
        " | rms over sigma | lift-off after, median / 95 % [ms] | slides later: found | false slips"
    )
    contact_cells = (
        "{run} | {n_touches} | {n_missed} / {n_twice} / {n_in_air} | {delay_p50_ms:.1f} / {delay_p99_ms:.1f}"
        " | {bias_ms:.1f} | {rms_over_sigma:.2f} | {lift_off_delay_p50_ms:.0f} / {lift_off_delay_p95_ms:.0f}"
        " | {n_later_found} of {n_later_slides} | {n_false_slips}"
    )
    first, *others = values["runs"]
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
    parts = [
        f"""Robots of a physics engine (`footsense/lab/walkers`): a hexapod of 2 kg and a quadruped of 12 kg, open-loop gaits with
joint PD, {len(values["runs"][first])} runs of 12 s. Robots, grounds and seeds of these runs are in no training and no choice of a threshold. The
whole estimation of the service runs on each conversion's readings, noise of the converter and the foot's own mass in
swing included; the response table that makes them is the network's. On `{first}` each run is scaled to a peak of
{PAPER_PEAK_N:g} N (one loaded millisecond in a thousand is above). A frame counts as loaded from {LOADED_REL:.0%} of the peak; mid-stance is from {1e3 * AFTER_TOUCH_S:g} ms
after the touch to {1e3 * BEFORE_END_S:g} ms before its end. A touch begins when the normal force exceeds {FIRST_LOAD_REL:.0%} of the peak. A slide counts
that goes over {1e3 * SLIDE_M:g} mm, as *later* if it begins more than {1e3 * LATER_S:g} ms after the touch.

![The force that the first foot felt, and what was published, in each run](motion-{first}.png)

{table(force_head, values["runs"][first], force_cells)}

{table(contact_head, values["runs"][first], contact_cells)}

{early}"""
    ]
    parts += [
        f"""### {name}, its own robot, real newtons

![The force that the first foot felt, and what was published, in each run](motion-{name}.png)

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
