"""Page `motion`: forces of feet that move, what a gait controller is told of them, and when."""

from functools import partial

import numpy as np

from footsense.estimation.missing_elements import Imputation
from footsense.estimation.network import sensitivity
from footsense.foot.directions import angles_between_deg, directions
from footsense.foot.specimen import ContactLoads
from footsense.frames import ELEMENTS, LEGS, Mask, Vector
from footsense.lab.evaluation.rough_walks import THRESHOLD_N, run_gait_tracker, score_walks, simulate_walk
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
#: Walks on rough ground, and conversions of each: a minute.
_N_WALKS, _ROUGH_CONVERSIONS, _QUICK_ROUGH_CONVERSIONS = 8, 22_000, 7_000
#: Touchdowns: full load [N], time to it [s], distance of the contact from the middle of the ball [deg].
_TOUCHDOWNS = {
    "hard, upright": (0.5, 5e-3, 0.0),
    "hard, 25 deg aside": (0.5, 5e-3, 25.0),
    "soft, upright": (1.0, 0.144, 0.0),
    "soft, 25 deg aside": (1.0, 0.144, 25.0),
}
#: Feet of each manner, touchdowns of each foot, time between two, on the ground, and of lifting [s].
_N_FEET, _N_TOUCHDOWNS, _CYCLE_S, _STANCE_S, _LIFT_S = 6, 25, (0.9, 1.1), 0.35, 0.05
#: Time after a touchdown in which the error of the force counts [s].
_FORCE_ERROR_S = 0.05


def compute(context: StudyContext) -> Values:
    """Estimate the force in gaits, walks, and touchdowns; score what is reported of walks on rough ground."""
    gaits, wrong_gains = _gaits(context)
    context.report_progress("gaits done")
    n_per_rel = sensitivity(context.network, 1, context.trained_inputs.moments).load_n_per_mean_closure
    n = _QUICK_ROUGH_CONVERSIONS if context.quick else _ROUGH_CONVERSIONS
    max_n, walks = context.foot_design.loads.max_n, []
    for number in range(1 if context.quick else _N_WALKS):
        walks.append(simulate_walk(context.response, context.network, n_per_rel, max_n, (0, number), n))
        context.report_progress(f"rough walk {number + 1} done")
    rough = score_walks(walks)
    walk = next(row for row in gaits if row["load"] == "measured walk")
    return {
        "n_random_gaits": 6 if context.quick else _N_GAITS,
        "gaits": gaits,
        "wrong_gains": wrong_gains,
        "rough": rough,
        "n_walks": len(walks),
        "touchdowns": _touchdowns(context, n_per_rel),
        "targets": [
            target(
                "measured walk, direction, mean / 95 % below (one walk, two legs)",
                "0.8 / 3 deg",
                f"{walk['direction_deg']:.1f} / {walk['direction_p95_deg']:.1f} deg",
                met=walk["direction_deg"] <= 0.8 and walk["direction_p95_deg"] <= 3.0,
            ),
            target(
                f"false touchdowns on rough ground, in {rough['swing_minutes']:.1f} min of swing",
                "0",
                f"{rough['n_false_touchdowns']}",
                met=rough["n_false_touchdowns"] == 0,
            ),
            target(
                "contact right, rough ground, of all conversions",
                "95 %",
                f"{rough['contact_correct_share']:.0%}",
                met=rough["contact_correct_share"] >= 0.95,
            ),
            target(
                "slides missed, rough ground, of those within range",
                "2 %",
                f"{rough['missed_slide_share']:.1%} of {rough['n_slides']}",
                met=rough["missed_slide_share"] <= 0.02,
            ),
        ],
    }


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


def _touchdowns(context: StudyContext, n_per_rel: float) -> list[Values]:
    """Return latency of contact and error of force after touchdowns of each manner."""
    n_feet, n_touchdowns = (2, 3) if context.quick else (_N_FEET, _N_TOUCHDOWNS)
    rows: list[Values] = []
    for manner, (full_n, rise_s, aside_deg) in _TOUCHDOWNS.items():
        rng = np.random.default_rng(len(rows))
        starts_s = np.cumsum(rng.uniform(*_CYCLE_S, (n_feet, n_touchdowns)), axis=1)
        n = int((starts_s.max() + 1.0) / STEP_S)
        azimuth_deg = rng.uniform(0.0, 360.0, n_feet)
        normals = directions(azimuth_deg, np.full(n_feet, 90.0 - aside_deg))
        feet = [
            partial(_touchdown_loads, own_s, normal, full_n, rise_s)
            for own_s, normal in zip(starts_s, normals, strict=True)
        ]
        readings = concatenate_gaits(
            [simulate_gait_readings(context.response, foot, ReadingConditions(), rng, n) for foot in feet]
        )
        sent_s = STEP_S * np.arange(1.0, n + 1) + readings.send_delay_s.mean(axis=0)
        told = run_gait_tracker(readings, context.network, n_per_rel, np.asarray(1e9 * sent_s, np.int64))
        contact = np.array(told.contact, bool)
        error_n = told.force_n[..., 2] - readings.true_force_at_sending_n[..., 2].T
        first_ms, squares_n2 = [], []
        for foot in range(n_feet):
            along_n = feet[foot](np.arange(0.0, sent_s[-1], 1e-4)).force_n[:, 2]
            for start_s in starts_s[foot].tolist():
                after = along_n[round(start_s * 1e4) :]
                crossed_s = start_s + np.argmax(after > THRESHOLD_N) * 1e-4
                heard = np.flatnonzero(contact[:, foot] & (sent_s > start_s))
                first_ms.append(1e3 * (sent_s[heard[0]] - crossed_s) if len(heard) else np.inf)
                judged = (sent_s > crossed_s) & (sent_s < crossed_s + _FORCE_ERROR_S)
                squares_n2.append(np.nanmean(error_n[judged, foot] ** 2))
        p50_ms, p99_ms = np.percentile(first_ms, (50, 99), method="nearest")
        rows.append(
            {
                "manner": manner,
                "n": len(first_ms),
                "latency_p50_ms": p50_ms,
                "latency_p99_ms": p99_ms,
                "force_rms_error_mn": 1e3 * np.sqrt(np.mean(squares_n2)),
            }
        )
    return rows


def _touchdown_loads(
    starts_s: Vector, normal: Vector, full_n: float, rise_s: float, t_s: Vector
) -> ContactLoads:
    """Return the loads of one foot [N]: it touches down at these times, rises within `rise_s` and is lifted."""
    place = np.searchsorted(starts_s, t_s, "right") - 1
    since_s = np.where(place >= 0, t_s - starts_s[place], np.inf)
    risen = np.clip(since_s / rise_s, 0.0, 1.0)
    risen = risen if rise_s < 0.01 else 0.5 - 0.5 * np.cos(np.pi * risen)
    pressing_n = full_n * risen * np.clip((_STANCE_S - since_s) / _LIFT_S, 0.0, 1.0)
    return ContactLoads(np.tile(normal, (len(t_s), 1)), pressing_n[:, None] * normal)


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
    touchdowns = table(
        "touchdown | number | contact after, median / 99 % below [ms] | fz in the 50 ms after it, rms [mN]",
        values["touchdowns"],
        "{manner} | {n} | {latency_p50_ms:.1f} / {latency_p99_ms:.1f} | {force_rms_error_mn:.0f}",
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

## Touchdown

From a load of {1e3 * THRESHOLD_N:g} mN along the leg, the threshold before swings have shown their noise, until a frame that is sent says
contact; feet without tremor in swing, on hard ground within 5 ms or as softly as a step of the walk. A frame goes out
after every conversion.

{touchdowns}

## On rough ground

{_rough_text(values["rough"], values["n_walks"])}
"""


def _rough_text(rough: Values, n_walks: int) -> str:
    figures = {
        "touchdown after the first load, median / 95 % below ({n_touchdowns} of over 0.1 N)": "{touchdown_delay_p50_ms:.1f} / {touchdown_delay_p95_ms:.1f} ms",
        "touchdowns missed": "{missed_touchdown_share:.1%}",
        "false touchdowns in {swing_minutes:.1f} min of swing": "{n_false_touchdowns}",
        "time of touchdown, back-dated, rms; over its sigma": "{touchdown_time_error_rms_ms:.1f} ms; {touchdown_time_error_rms_sigmas:.2f}",
        "time of lift-off, back-dated, rms": "{lift_off_time_error_rms_ms:.1f} ms",
        "contact right, of all conversions": "{contact_correct_share:.1%}",
        "tangential over normal force, mean error": "{tangential_over_normal_error:.3f}",
        "ground normal, mean error": "{normal_error_deg:.1f} deg",
        "way slid until a slip is said, mean ({n_slides} slides of over 5 mm)": "{slide_before_report_mm:.1f} mm",
        "slides missed, of these": "{missed_slide_share:.1%}",
        "slides beyond the converter's range, which no force can tell": "{n_slides_beyond_range}",
        "false slips, far below the ground's friction": "{n_false_slips}",
        "slips said of feet at the cone that do not move": "{n_slips_without_slide}",
        "coefficient of friction learnt, rms error": "{friction_coefficient_error_rms:.3f}",
    }
    rows = [(said.format(**rough), figure.format(**rough)) for said, figure in figures.items()]
    return f"""{n_walks} walks of six feet, {rough["leg_minutes"]:.0f} minutes of legs after 10 s in which thresholds and friction are learnt: random
stances on stones and slopes of up to 30 deg, hard and soft ground of coefficients 0.2 to 0.6 on which feet stick, creep
and slide, and in three stances of ten are dragged over 5 to 30 mm; in swing the foot's own inertia shakes the sensor.
Contact and the rest are what the service's own estimation says.

{table("said | figure", rows)}

A foot that sticks at the cone and one that slides there have the same friction ratio: with force alone, without inertia
or joint angles, the difference cannot be told, and both are said to slip."""
