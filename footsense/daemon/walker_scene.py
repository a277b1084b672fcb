"""Scenes of the robot of a foot type that walks on its feet in a physics engine: `walker:GAIT`, `walker:GAIT:GROUND`.

The part of the lab that simulates it is imported where such a scene is named, which no robot does.
"""

import logging
import math
from typing import TYPE_CHECKING

from footsense.config import Config
from footsense.daemon.foot_types import foot_type_of
from footsense.errors import ConfigError, require
from footsense.progress import timed_bar
from footsense.sim.scene import USUAL_EFFECTS, USUAL_HOST_COST_US, Scene, load_scene
from footsense.sim.scene_loads import LogLoads

if TYPE_CHECKING:
    from footsense.lab.walkers.split import WalkerRun

_log = logging.getLogger(__name__)

PREFIX = "walker:"
#: Robot of each foot type, and force to which its loads are scaled [N]; None for those of the robot.
_ROBOTS: dict[str, tuple[str, float | None]] = {
    "aoyagi-3x3": ("hexapod-300g", 1.0),
    "hexapod-2kg": ("hexapod-2kg", None),
    "quadruped-12kg": ("quadruped-12kg", None),
}
#: Shortest and longest walk that is simulated; the rest repeats it [s].
_SHORTEST_S, _LONGEST_S = 2.0, 60.0
_SEED = 1
#: Usual time of a second of a walk [s].
_COST_REL = 0.35


def scene_of(name: str, config: Config, duration_s: float = math.inf) -> Scene:
    """Return a scene by its name, the path of its file, or as `walker:GAIT` and `walker:GAIT:GROUND`.

    Args:
        name: Which scene.
        config: The robot, whose foot type says which robot walks.
        duration_s: Duration of the run [s]; of a walk so much is simulated, up to a minute.

    Raises:
        ConfigError: There is no such scene, it is not a valid one, or no robot that walks has this foot or its legs.
    """
    foot_type = foot_type_of(config)
    if not name.startswith(PREFIX):
        scene = load_scene(name)
        if scene.foot_type not in {None, foot_type}:
            _log.warning(
                "scene %s: its loads are for foot type %s; these feet, %s, may be overloaded by them, or not feel them"
                "; set foot_type: %s in the file of --config",
                name,
                scene.foot_type,
                foot_type,
                scene.foot_type,
            )
        return scene
    if foot_type not in _ROBOTS:
        raise ConfigError(
            f"scene {name}: no robot is known that walks on foot type {foot_type!r}, only on {', '.join(_ROBOTS)}; "
            "`footsense lab walk` writes the log of one, which a scene of kind log scales to your foot"
        )
    require(f"scene {name}", "walkers", "mujoco")
    from footsense.lab.walkers.robots import ROBOTS
    from footsense.lab.walkers.split import WalkerRun

    gait, _, ground = name.removeprefix(PREFIX).partition(":")
    robot, peak_force_n = _ROBOTS[foot_type]
    legs = ROBOTS[robot].legs
    if absent := [leg for leg in config.legs if leg not in legs]:
        raise ConfigError(f"scene {name}: {robot} has the legs {', '.join(legs)}, not {', '.join(absent)}")
    walk_s = math.ceil(min(max(duration_s, _SHORTEST_S), _LONGEST_S))
    run = WalkerRun(robot, gait, ground or "flat", _SEED, walk_s)
    scale = "its own forces" if peak_force_n is None else f"forces scaled to {peak_force_n:g} N"
    try:
        return _scene_of_run(run, peak_force_n, f"{gait} on {run.ground}: {scale}")
    except ConfigError as error:
        raise ConfigError(f"scene {name}: {error}") from None


def judging_scene(foot_type: str, number: int) -> Scene:
    """Return the scene of one of the walks that judge footsense, on which nothing was trained or chosen.

    Args:
        foot_type: Foot type of the robot, one of the two larger.
        number: Number of the walk of its robot; beyond the last one they begin anew.

    Raises:
        ConfigError: There is no MuJoCo, or no such walk of that robot.
    """
    require("the walks of judgement", "walkers", "mujoco")
    from footsense.lab.walkers.split import JUDGEMENT

    runs = [run for run in JUDGEMENT if run.robot == _ROBOTS[foot_type][0]]
    run = runs[number % len(runs)]
    return _scene_of_run(run, None, f"{run.gait} on {run.ground}")


def _scene_of_run(run: "WalkerRun", peak_force_n: float | None, words: str) -> Scene:
    from footsense.lab.walkers.split import cache_folder

    with timed_bar("the robot walks", _COST_REL * run.duration_s):
        file = run.saved(cache_folder())
    return Scene(
        description=f"{run.robot} walks in MuJoCo, {words}, repeated every {run.duration_s:g} s",
        load=LogLoads(file=str(file), peak_force_n=peak_force_n),
        host_cost_us=USUAL_HOST_COST_US,
        effects=USUAL_EFFECTS,
    )
