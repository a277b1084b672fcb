"""Page `motion`: forces of feet that move, what a gait controller is told of them, and when."""

from collections.abc import Sequence
from functools import partial
from itertools import chain, pairwise

import numpy as np

from footsense.foot.contact_coordinates import normals_of_stereographic_points
from footsense.foot.directions import angles_between_deg
from footsense.foot.network_card import NETWORK_FILE
from footsense.frames import Leg, Vector
from footsense.lab.evaluation import walker_scores
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE
from footsense.lab.evaluation.walker_judgement import (
    JudgedRun,
    contact_figures,
    judge,
    pooled,
    slip_figures,
)
from footsense.lab.evaluation.walker_runs import HOST_COST_US, SCAN_TIMES, ScanTimes, ToldMotion
from footsense.lab.foot_file import FOOT_FILE
from footsense.lab.report import StudyContext, Values
from footsense.lab.studies.boards.many_feet import (
    missing_figures,
    smooth_tripod,
    step_figures,
)
from footsense.lab.studies.boards.service_walks import END_S, OWN_FEET, service_figures
from footsense.lab.studies.boards.targets import WANTED, WANTED_FILE, board_targets
from footsense.lab.training.export import OnnxNetwork
from footsense.lab.training.gait_readings import (
    GaitReadings,
    ReadingConditions,
    concatenate_gaits,
    loads_of,
    random_gaits,
    simulate_gait_readings,
)
from footsense.lab.training.gait_windows import (
    contact_and_normal_force,
    estimate_in_batches,
    windows_of,
)
from footsense.lab.walkers import slow_loads
from footsense.lab.walkers.gaits import GAITS_FILE
from footsense.lab.walkers.made_up import SHAKING, SLOW, MadeUpLoads
from footsense.lab.walkers.split import KNOWN_JUDGEMENT, NEW_JUDGEMENT, RECORDED_JUDGEMENT, WalkerRun
from footsense.ports import LoadEstimator
from footsense.sim.loads.ground_load import ContactSource
from footsense.sim.loads.walk import Walk, measured_walk, trot_reaction

TITLE = "Force in motion, and what a gait controller is told"

#: Seed of the gaits that judge; training uses another. Times of a random gait and of a walk [s].
_SEED = 990_001
_N_GAITS, _GAIT_S, _WALK_S, _QUICK_WALK_S = 200, 3.0, 6.8, 1.1
#: Least force of a direction, of a friction ratio, and least normal force of a contact normal [N].
DIRECTION_N, FRICTION_N, NORMAL_N = 0.1, 0.3, 0.5
_WALK_START_NS = 200_000_000
#: A trot with the times of a Unitree Go1's: stride and stance [s], and times in which the force rises to 70 % [s].
TROT_STRIDE_S, TROT_STANCE_S = 0.67, 0.4
_TROT_RISES_S: dict[Leg, float] = {"lf": 0.02, "rf": 0.04, "lr": 0.06, "rr": 0.08}
#: Noise of a conversion over the board's [1], beside it: what an AD7147 has is not confirmed by a source.
_NOISE_REL = (0.3, 3.0)
#: Slow loads that judge; those of the selection have other seeds.
_SLOW = (MadeUpLoads(SLOW, 9900, 20.0), MadeUpLoads(SLOW, 9901, 20.0))
_SHAKING = MadeUpLoads(SHAKING, 9950, 20.0)
#: Runs of a quick page, and duration of those in new gaits [s].
_QUICK_RUNS, _QUICK_NEW_RUNS, _QUICK_S = slice(1, None, 12), slice(0, None, 13), 4.0


def compute(context: StudyContext) -> Values:
    """Judge the feet of each board by walking robots; estimate the force in random gaits and walks."""
    boards = {board: _figures(context, board) for board in WANTED}
    return {
        "n_random_gaits": 6 if context.quick else _N_GAITS,
        "boards": boards,
        "targets": [
            row | {"figure": f"`{board}`: {row['figure']}"}
            for board, figures in boards.items()
            for row in figures["targets"]
        ],
    }


def _figures(context: StudyContext, board: str) -> Values:
    """Return the figures of a board."""
    feet = [context, *(context.foot(name) for name in OWN_FEET)]
    folders = [foot.files(FOOT_FILE, RESPONSE_FILE, NETWORK_FILE) for foot in feet]
    gaits = _gaits(context, OnnxNetwork(folders[0] / NETWORK_FILE), SCAN_TIMES[board])
    context.report_progress(f"{board}: gaits done")
    figures = {
        "gaits": gaits,
        "step": step_figures(context, board),
        "missing": missing_figures(context, board),
    }
    context.report_progress("steps and missing elements done")
    figures |= service_figures(context, board)
    context.report_progress("walks through the service done")
    judged_under = partial(judge, folders, board=board)
    new: tuple[WalkerRun, ...] = NEW_JUDGEMENT
    slow: tuple[MadeUpLoads, ...] = _SLOW
    for file in (GAITS_FILE, WANTED_FILE, *(walk.file for walk in RECORDED_JUDGEMENT)):
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
    figures |= {
        "runs": {name: [_row(one) for one in by_foot[name]] for name in list(by_foot)[1:]},
        "pooled": {name: pooled(runs) for name, runs in by_foot.items()},
        "new_gaits": _contacts_by_gait(new_judged),
        "shaking": [_row(one) for one in shaking],
        "contacts": contact_figures([*new_judged, *slow_judged]),
        "contacts_with_motion": contact_figures(moving),
        "slips": slips,
    }
    return figures | {"targets": board_targets(board, figures)}


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


def _walked(
    context: StudyContext,
    conditions: ReadingConditions,
    source: ContactSource,
    legs: tuple[str, ...],
    viscous_rel: float = 0.0,
    noise_rel: float = 1.0,
) -> GaitReadings:
    conditions = conditions._replace(viscous_rel=viscous_rel, noise_pf=noise_rel * conditions.noise_pf)
    n = round((_QUICK_WALK_S if context.quick else _WALK_S) / conditions.step_s)
    return concatenate_gaits(
        [
            simulate_gait_readings(
                context.response,
                loads_of(source, leg),
                conditions,
                np.random.default_rng((_SEED, row)),
                n,
            )
            for row, leg in enumerate(legs)
        ]
    )


def _gaits(context: StudyContext, network: LoadEstimator, scan: ScanTimes) -> list[Values]:
    """Return the errors in gaits and walks."""
    n_gaits = 6 if context.quick else _N_GAITS
    max_n = context.foot_design.loads.max_n
    conditions = ReadingConditions(
        step_s=scan.conversion_s,
        send_delay_s=scan.newest_s,
        noise_pf=scan.noise_pf,
        range_end_pf=scan.range_end_pf,
    )
    random = random_gaits(
        context.response, _SEED, n_gaits, round(_GAIT_S / scan.conversion_s), max_n, scan=conditions
    )
    walk = measured_walk(1.0, 10.0, _WALK_START_NS)
    sides = ("rf", "lf")
    errors, walked = partial(_errors, network), partial(_walked, context, conditions)
    return [
        errors("random gaits", random),
        errors("measured walk", walked(walk, sides)),
        errors("tripod", walked(smooth_tripod(1.0, _WALK_START_NS), ("rf",))),
        errors("trot of a robot dog", walked(_dog_trot(), tuple(_TROT_RISES_S))),
        errors("walk, rubber creeps and lags", walked(walk, sides, viscous_rel=1.0)),
        *(
            errors(f"measured walk, noise x {rel:g}", walked(walk, sides, noise_rel=rel))
            for rel in _NOISE_REL
        ),
    ]


def _dog_trot() -> Walk:
    """Return the trot of a robot dog of 1 N peak."""
    return Walk(
        {
            leg: trot_reaction(TROT_STANCE_S / TROT_STRIDE_S, rise_s / TROT_STANCE_S, 1.0, 0.15)
            for leg, rise_s in _TROT_RISES_S.items()
        },
        period_ns=round(1e9 * TROT_STRIDE_S),
        duty_rel=TROT_STANCE_S / TROT_STRIDE_S,
        pitch_deg=10.0,
        from_ns=_WALK_START_NS,
    )


def _errors(network: LoadEstimator, load: str, gaits: GaitReadings) -> Values:
    """Return the errors of the network over all windows of gaits."""
    window, (normal, force_n) = windows_of(gaits)
    found = estimate_in_batches(network, window)
    loaded = np.linalg.norm(force_n, axis=1) > DIRECTION_N
    error_n = (found.force_n - force_n)[loaded]
    off = np.abs(error_n / found.sigma_n[loaded])
    direction_deg = angles_between_deg(found.force_n[loaded], force_n[loaded])
    true_contact, pressing_n = contact_and_normal_force(force_n, normal)
    firm, firmer = pressing_n > FRICTION_N, pressing_n > NORMAL_N
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


def shown(values: Values) -> Values:
    """Return the rows of what is wanted of the boards, walks of more than one kind, and where constants are."""
    boards = values["boards"]
    figures = dict.fromkeys(row["figure"] for of_board in boards.values() for row in of_board["targets"])
    reached = {
        board: {
            row["figure"]: f"{row['measured']} ({row['target']})" + ("" if row["met"] else ", **missed**")
            for row in of_board["targets"]
        }
        for board, of_board in boards.items()
    }
    return {
        "wanted": [(one, *(of_board.get(one, "-") for of_board in reached.values())) for one in figures],
        "holds_bounds": list(pairwise(walker_scores.HOLDS_BOUNDS)),
        "walks": {board: one["own_robots"] | one["couplings"] for board, one in boards.items()},
        "of_own_robots": {board: list(chain(*one["runs"].values())) for board, one in boards.items()},
        "host_cost_us": HOST_COST_US,
        "end_s": END_S,
        "motion": ToldMotion(),
        "scores": walker_scores,
        "slow": slow_loads,
    }
