"""Page `odometry`: how far a walking robot's pose drifts, by what its feet can sense."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from footsense.foot.network_card import NETWORK_FILE
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE
from footsense.lab.odometry.run import GATE, Filter, run_filters
from footsense.lab.odometry.sources import sources
from footsense.lab.odometry.walk import KNOWN_ROBOT, PUBLISH_EVERY, OdometryWalk, WrongRobot
from footsense.lab.parallel import compute_each
from footsense.lab.report import SAME_TABLE, StudyContext, Values, table, target
from footsense.lab.walkers.split import WalkerRun

TITLE = "Odometry: what a robot gains from the force on its feet"

#: Robot, gait and ground of each walk.
_WALKS: tuple[tuple[str, str, str], ...] = (
    ("hexapod-2kg", "tripod", "flat"),
    ("hexapod-2kg", "tripod", "friction-0.3"),
    ("hexapod-2kg", "tripod", "rough"),
    ("quadruped-12kg", "trot-fast", "flat"),
    ("quadruped-12kg", "trot-slow", "flat"),
    ("quadruped-12kg", "trot-slow", "friction-0.3"),
    ("quadruped-12kg", "walk", "flat"),
    ("quadruped-12kg", "walk", "rough"),
)
_FIRST_SEED, _N_SEEDS, _DURATION_S = 4200, 5, 12.0
#: Walks of a quick page, and their time [s].
_QUICK_WALKS, _QUICK_DURATION_S = slice(3, 4), 4.0
_BOARDS = tuple(PUBLISH_EVERY)
_TRUTH, _FORCE, _HOLDS, _ONE_AXIS = "truth, weights", "force vector", "holds", "one-axis sensor"
_IN_WORDS = {_FORCE: "the force vector", _HOLDS: "whether feet hold"}
#: What a robot may know wrongly, and the sources that are tried with it.
_WRONG = {
    "nothing": KNOWN_ROBOT,
    "lengths of thighs and shanks, 1 %": WrongRobot(length_rel=0.01),
    "zeros of the encoders, 0.5 deg": WrongRobot(encoder_deg=0.5),
    "mounting of the IMU, 0.5 deg": WrongRobot(mounting_deg=0.5),
}
_WRONG_SOURCES = (_TRUTH, f"`{_BOARDS[0]}`, {_FORCE}", "good one-axis sensor, weights")
_GATES = ("no gate", "gate")
#: Largest drift with the force vector over that with the truth, and over that with the best one-axis sensor, by gate, and
#: with feet that hold over that with the truth, without gate [1].
_OVER_TRUTH, _OVER_ONE_AXIS, _HOLDS_OVER_TRUTH = 1.1, {"no gate": 0.5, "gate": 0.8}, 1.5
#: Sources of the picture, without gate, and rows of the walk between two of its points.
_SHOWN = (f"`{_BOARDS[0]}`, {_FORCE}", f"`{_BOARDS[0]}`, contact flag", "good one-axis sensor, weights")
_SHOWN_RUN, _SHOWN_EVERY = ("quadruped-12kg", "trot-slow", "flat"), 10


class _Drifted(NamedTuple):
    """One walk: its way [m], drift by error, source and gate [%], and what a picture shows of it."""

    way_m: float
    drift: dict[str, dict[str, dict[str, float]]]
    paths_m: dict[str, Vector]


def compute(context: StudyContext) -> Values:
    """Let robots walk, and their poses be followed with contact from each source."""
    folders = {
        robot: context.foot(robot).files(RESPONSE_FILE, NETWORK_FILE)
        for robot in dict.fromkeys(robot for robot, _, _ in _WALKS)
    }
    walks = _WALKS[_QUICK_WALKS] if context.quick else _WALKS
    n_seeds, duration_s = (1, _QUICK_DURATION_S) if context.quick else (_N_SEEDS, _DURATION_S)
    runs = [
        WalkerRun(robot, gait, ground, _FIRST_SEED + seed, duration_s)
        for robot, gait, ground in walks
        for seed in range(n_seeds)
    ]
    drifted = compute_each(partial(_drifted, folders=folders), runs, scheduler=context.scheduler)
    shown = next((k for k, run in enumerate(runs) if run[:3] == _SHOWN_RUN), 0)
    context.drawings["odometry.png"] = _draw(runs[shown], drifted[shown].paths_m)
    drift = {
        error: {
            source: {gate: [one.drift[error][source][gate] for one in drifted] for gate in _GATES}
            for source in drifted[0].drift[error]
        }
        for error in _WRONG
    }
    return {
        "walks": [run.name for run in runs[::n_seeds]],
        "n_seeds": n_seeds,
        "duration_s": duration_s,
        "way_m": [one.way_m for one in drifted],
        "drift": drift,
        "shown": runs[shown].name,
        "targets": _targets(drift["nothing"]),
    }


def _drifted(run: WalkerRun, folders: dict[str, Path]) -> _Drifted:
    """Return the drift of one walk with each source."""
    walk = OdometryWalk(run)
    published = {board: walk.published(board, folders[run.robot]) for board in _BOARDS}
    right = walk.senses()
    known = sources(walk, right, published)
    keys = [("nothing", source, gate) for source in known for gate in _GATES]
    keys += [
        (error, source, gate) for error in list(_WRONG)[1:] for source in _WRONG_SOURCES for gate in _GATES
    ]
    senses = {error: walk.senses(wrong) for error, wrong in _WRONG.items()}
    poses = run_filters(
        walk, [Filter(known[source], senses[error], gate == "gate") for error, source, gate in keys]
    )
    drift: dict[str, dict[str, dict[str, float]]] = {error: {} for error in _WRONG}
    for (error, source, gate), one in zip(
        keys, walk.drift_rel(poses.position_m, poses.rotation).tolist(), strict=True
    ):
        drift[error].setdefault(source, {})[gate] = one
    paths_m = {"truth": walk.position_m[::_SHOWN_EVERY]}
    for source in _SHOWN:
        place = poses.position_m[::_SHOWN_EVERY, keys.index(("nothing", source, "no gate"))]
        paths_m[source] = place @ _level(walk.rotation[0]).T + walk.position_m[0]
    return _Drifted(float(walk.way_m[-1]), drift, paths_m)


def _level(rotation: Vector) -> Vector:
    """Return the rotation about the vertical that points a pose's own x axis forward as an attitude does."""
    x, y = rotation[:2, 0] / np.linalg.norm(rotation[:2, 0])
    return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])


def _ratio(of: Sequence[float], to: Sequence[float]) -> Values:
    """Return the geometric mean of the ratios of paired runs, its spread as a factor, and the worst."""
    logs = np.log(np.array(of) / np.array(to))
    return {
        "mean": np.exp(logs.mean()),
        "factor": np.exp(logs.std(ddof=1)) if len(logs) > 1 else 1.0,
        "worst": np.exp(logs.max()),
    }


def _best_one_axis(drift: Values, gate: str) -> str:
    """Return the one-axis sensor that drifts least, by geometric mean."""
    found = [source for source in drift if _ONE_AXIS in source]
    return min(found, key=lambda source: float(np.log(drift[source][gate]).mean()))


def _targets(drift: Values) -> list[dict[str, object]]:
    rows = []
    for board in _BOARDS:
        for gate in _GATES:
            best = _best_one_axis(drift, gate)
            wanted = [(_FORCE, _TRUTH, _OVER_TRUTH), (_FORCE, best, _OVER_ONE_AXIS[gate])]
            if gate == _GATES[0]:
                wanted.append((_HOLDS, _TRUTH, _HOLDS_OVER_TRUTH))
            for source, other, limit in wanted:
                of = _ratio(drift[f"`{board}`, {source}"][gate], drift[other][gate])
                name = "truth as weights" if other == _TRUTH else f"the best {_ONE_AXIS}"
                rows.append(
                    target(
                        f"`{board}`: odometry, drift with {_IN_WORDS[source]} over that with {name}, {gate}, geometric mean",
                        f"{limit:g}",
                        f"{of['mean']:.2f}, worst run {of['worst']:.2f} ({other})",
                        met=of["mean"] <= limit,
                    )
                )
    return rows


def _draw(run: WalkerRun, paths_m: dict[str, Vector]) -> Figure:
    """Return a picture of a walk from above."""
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    axes = figure.subplots()
    for source, path_m in paths_m.items():
        style: dict[str, Any] = {"color": "black", "lw": 2.5} if source == "truth" else {"lw": 1.2}
        axes.plot(path_m[:, 0], path_m[:, 1], label=source.replace("`", ""), **style)
        axes.plot(*path_m[-1, :2], "o", ms=5, color=axes.lines[-1].get_color())
    axes.set(title=f"{run.name}, {run.duration_s:g} s, no gate", xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure


def text(values: Values) -> str:
    """Return the page's Markdown."""
    drift = values["drift"]["nothing"]
    of_gates = [f"{gate}: {figure}" for gate in _GATES for figure in ("mean [%]", "over truth", "worst [%]")]
    rows = [(source, *(cell for gate in _GATES for cell in _cells(drift, source, gate))) for source in drift]
    by_source = table(f"contact from, {SAME_TABLE} | " + " | ".join(of_gates), rows)
    n_seeds = values["n_seeds"]
    by_walk = table(
        f"contact from, {SAME_TABLE}; no gate / gate [%] | " + " | ".join(values["walks"]),
        [
            (
                source,
                *(
                    _of_walk(drift[source], first, n_seeds)
                    for first in range(0, len(values["way_m"]), n_seeds)
                ),
            )
            for source in drift
        ],
    )
    wrong = table(
        f"what the robot knows wrongly, {SAME_TABLE}; no gate / gate [%] | " + " | ".join(_WRONG_SOURCES),
        [
            (error, *(_of_walk(of_error[source], 0, len(values["way_m"])) for source in _WRONG_SOURCES))
            for error, of_error in values["drift"].items()
        ],
    )
    ratios = table(
        f"force vector over, {SAME_TABLE} | board | gate | geometric mean | spread, factor | worst run",
        [
            (other, f"`{board}`", gate, *_ratio_cells(drift, board, other, gate))
            for board in _BOARDS
            for gate in _GATES
            for other in (_TRUTH, _best_one_axis(drift, gate), f"`{board}`, contact flag")
        ],
    )
    wanted = table(
        "figure | wanted | measured",
        [
            (row["figure"], row["target"], row["measured"] + ("" if row["met"] else ", **missed**"))
            for row in values["targets"]
        ],
    )
    shortest_m, longest_m = min(values["way_m"]), max(values["way_m"])
    return f"""
Robots walk in MuJoCo with open-loop gaits: {len(values["walks"])} kinds of walk, {n_seeds} seeds each, {values["duration_s"]:g} s and {shortest_m:.1f} to {longest_m:.1f} m long. The
invariant Kalman filter of [examples/odometry.py](../../examples/odometry.py) finds their pose from joint angles, an IMU and
what is known of the footholds. *Drift* is the error of the place after a metre of way, rms over all metres of a walk.
*Gate*: a foothold whose squared innovation is above {GATE:g} is set down anew, and the noise of all is a third. *Over truth*:
geometric mean of the ratios of paired runs, true forces as weights being 1.

{wanted}

![The walk {values["shown"]} from above: the true path, and those found](odometry.png)

## Contact from

*Flag*: a foothold holds or it does not. *Weights*: its process noise grows with (0.5 / load)^2, and with the ratio of
tangential to normal force over the friction; a one-axis sensor and torques know the load alone. Forces and contact flag
are the service's, with the time of CAN: the force of every second frame of `ad7147`, of every fourth of `fdc1004`. The
vertical is by the filter's own attitude. One-axis sensors, torques and schedule have no delay.

{by_source}

{ratios}

## By walk

Mean over the seeds:

{by_walk}

## A robot that knows itself badly

Standard deviations, drawn anew for each seed; mean over all walks:

{wrong}

## What is simulated

IMU: noise of a Bosch BMI088 by its data sheet, and biases as a calibration leaves them, 0.05 deg/s and 0.1 m/s2. Encoders: 0.1 deg. A *good*
one-axis sensor errs by 2 % of gain and 1 % of a standing load, with 3 ms of lag; a *cheap* one by 35 % and 12 %, with
20 ms. They lie along the shank and feel the foot's mass in swing. Torques have 5 % of friction and 2 % of noise. Yaw is
the gyro's, whatever the feet know. Gaits that are not balanced drag their feet: a controller that places its feet
slides less, and gains less without a gate. Rubber that creeps and bodies that flex are on no row.
"""


def _cells(drift: Values, source: str, gate: str) -> tuple[str, str, str]:
    given = 100.0 * np.array(drift[source][gate])
    over = _ratio(drift[source][gate], drift[_TRUTH][gate])["mean"]
    return f"{given.mean():.2f} +- {given.std():.2f}", f"{over:.2f}", f"{given.max():.2f}"


def _ratio_cells(drift: Values, board: str, other: str, gate: str) -> tuple[str, str, str]:
    of = _ratio(drift[f"`{board}`, {_FORCE}"][gate], drift[other][gate])
    return f"{of['mean']:.2f}", f"{of['factor']:.2f}", f"{of['worst']:.2f}"


def _of_walk(of_source: Values, first: int, n: int) -> str:
    return " / ".join(f"{100.0 * np.mean(of_source[gate][first : first + n]):.2f}" for gate in _GATES)
