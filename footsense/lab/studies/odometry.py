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
from footsense.lab.odometry.walk import PUBLISH_EVERY, OdometryWalk
from footsense.lab.parallel import compute_each
from footsense.lab.report import StudyContext, Values
from footsense.lab.walkers.gaits import GAITS_FILE
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
_TRUTH, _FORCE = "truth, weights", "force vector"
_GATES = ("no gate", "gate")
#: Sources of the picture, without gate, and rows of the walk between two of its points.
_SHOWN = (f"`{_BOARDS[0]}`, {_FORCE}", f"`{_BOARDS[0]}`, contact flag", "good one-axis sensor, weights")
_SHOWN_RUN, _SHOWN_EVERY = ("quadruped-12kg", "trot-slow", "flat"), 10


class _Drifted(NamedTuple):
    """One walk: its way [m], drift by source and gate [1], and what a picture shows of it."""

    way_m: float
    drift: dict[str, dict[str, float]]
    paths_m: dict[str, Vector]


def compute(context: StudyContext) -> Values:
    """Let robots walk, and their poses be followed with contact from each source."""
    folders = {
        robot: context.foot(robot).files(RESPONSE_FILE, NETWORK_FILE)
        for robot in dict.fromkeys(robot for robot, _, _ in _WALKS)
    }
    context.table_file(GAITS_FILE)
    walks = _WALKS[_QUICK_WALKS] if context.quick else _WALKS
    n_seeds, duration_s = (1, _QUICK_DURATION_S) if context.quick else (_N_SEEDS, _DURATION_S)
    runs = [
        WalkerRun(robot, gait, ground, _FIRST_SEED + seed, duration_s)
        for robot, gait, ground in walks
        for seed in range(n_seeds)
    ]
    drifted = compute_each(partial(_drifted, folders=folders), runs)
    shown = next((k for k, run in enumerate(runs) if run[:3] == _SHOWN_RUN), 0)
    context.drawings["odometry.png"] = _draw(runs[shown], drifted[shown].paths_m)
    drift = {
        source: {gate: [one.drift[source][gate] for one in drifted] for gate in _GATES}
        for source in drifted[0].drift
    }
    return {
        "walks": [run.name for run in runs[::n_seeds]],
        "n_seeds": n_seeds,
        "duration_s": duration_s,
        "way_m": [one.way_m for one in drifted],
        "drift": drift,
        "shown": runs[shown].name,
    }


def _drifted(run: WalkerRun, folders: dict[str, Path]) -> _Drifted:
    """Return the drift of one walk with each source."""
    walk = OdometryWalk(run)
    published = {board: walk.published(board, folders[run.robot]) for board in _BOARDS}
    senses = walk.senses()
    known = sources(walk, senses, published)
    keys = [(source, gate) for source in known for gate in _GATES]
    position_m, rotation = run_filters(
        walk, senses, [Filter(known[source], gate == "gate") for source, gate in keys]
    )
    drift: dict[str, dict[str, float]] = {source: {} for source in known}
    for (source, gate), one in zip(keys, walk.drift_rel(position_m, rotation).tolist(), strict=True):
        drift[source][gate] = one
    paths_m = {"truth": walk.position_m[::_SHOWN_EVERY]}
    for source in _SHOWN:
        place = position_m[::_SHOWN_EVERY, keys.index((source, "no gate"))]
        paths_m[source] = place @ _level(walk.rotation[0]).T + walk.position_m[0]
    return _Drifted(float(walk.way_m[-1]), drift, paths_m)


def _level(rotation: Vector) -> Vector:
    """Return the rotation about the vertical that points a pose's own x axis forward as an attitude does."""
    x, y = rotation[:2, 0] / np.linalg.norm(rotation[:2, 0])
    return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])


def _ratio(of: Sequence[float], to: Sequence[float]) -> Values:
    """Return the geometric mean of the ratios of paired runs, and the worst."""
    logs = np.log(np.array(of) / np.array(to))
    return {"mean": np.exp(logs.mean()), "worst": np.exp(logs.max())}


def _ratios(drift: Values, board: str, gate: str) -> Values:
    """Return what a board's forces drift over the truth and over the one-axis sensor that drifts least."""

    def ratio(source: str, to: str) -> Values:
        return _ratio(drift[f"`{board}`, {source}"][gate], drift[to][gate])

    best = min(
        (source for source in drift if "one-axis sensor" in source),
        key=lambda source: float(np.log(drift[source][gate]).mean()),
    )
    return {
        f"{_FORCE} over truth": ratio(_FORCE, _TRUTH),
        f"{_FORCE} over one axis": ratio(_FORCE, best),
        "holds over truth": ratio("holds", _TRUTH),
        "one axis": best,
    }


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


def shown(values: Values) -> Values:
    """Return the ratios of the drifts by board and gate, and the rows of the sources."""
    drift = values["drift"]
    return {
        "boards": {board: {gate: _ratios(drift, board, gate) for gate in _GATES} for board in _BOARDS},
        "sources": [
            (source, *(cell for gate in _GATES for cell in _cells(drift, source, gate))) for source in drift
        ],
        "gate": GATE,
    }


def _cells(drift: Values, source: str, gate: str) -> tuple[str, str, str]:
    given = 100.0 * np.array(drift[source][gate])
    over = _ratio(drift[source][gate], drift[_TRUTH][gate])["mean"]
    return f"{given.mean():.2f} +- {given.std():.2f}", f"{over:.2f}", f"{given.max():.2f}"
