"""A scene: motion, loads, effects and faults of a simulated robot, as a YAML file.

An effect that a scene does not name is not computed. Named scenes are in `footsense/sim/scenes`.
"""

import math
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from footsense import strict_yaml
from footsense.errors import ConfigError
from footsense.sim import scene_loads
from footsense.sim.faults.scene_faults import FORMER_FAULTS, Fault
from footsense.sim.scene_effects import Effects, Fabrication, ScenePart

#: Lowest elevation of a contact [deg].
LOWEST_ELEVATION_DEG = 30


class Scene(ScenePart, frozen=True):
    """Motion, loads, effects and faults of a simulated robot.

    Attributes:
        description: One line for the reader.
        load: Load of the feet.
        lead_in_s: Time before the load, all feet in the air: the feet are tared in it [s].
        host_cost_us: Cost of every I2C transaction on the host [us].
        seed: Seed of everything random.
        gait_table: Whether the capacitances over a gait cycle are computed once and interpolated, for long walks:
            0.2 fF off as long as no gap closes.
        effects: Deviations from the ideal.
        fabrication: Deviations of the feet; None for feet as designed.
        faults: Faults.
    """

    description: str
    load: scene_loads.Load
    lead_in_s: Annotated[float, Meta(ge=0.0)] = 1.0
    host_cost_us: Annotated[float, Meta(ge=0.0, le=10_000.0)] = 0.0
    seed: Annotated[int, Meta(ge=0)] = 1
    gait_table: bool = False
    effects: Effects = Effects()
    fabrication: Fabrication | None = None
    faults: tuple[Fault, ...] = ()


def scene_names() -> list[str]:
    """Return the names of the scenes of the package."""
    folder = files("footsense.sim") / "scenes"
    return sorted(
        entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml")
    )


def load_scene(name_or_path: str) -> Scene:
    """Return a scene of the package by name, or the scene of a YAML file.

    Raises:
        ConfigError: There is no such scene, or it is not a valid one.
    """
    source: Path | str = Path(name_or_path)
    where = None
    if name_or_path in scene_names():
        resource = files("footsense.sim") / "scenes" / f"{name_or_path}.yaml"
        source, where = resource.read_text(encoding="utf-8"), f"scene {name_or_path}"
    elif not Path(name_or_path).suffix:
        raise ConfigError(
            f"no scene {name_or_path!r}: there are {', '.join(scene_names())}, or give the path of a YAML file"
        )
    return strict_yaml.load(
        source, Scene, where, check=_contradiction, former=FORMER_FAULTS | scene_loads.FORMER_LOADS
    )


def _contradiction(scene: Scene) -> strict_yaml.Problem | None:
    """Return the first contradiction between parts that are each valid."""
    if (problem := _too_low(scene)) is not None:
        return problem
    if scene.gait_table and scene.effects.rubber:
        return strict_yaml.Problem(
            "effects.rubber", "depends on the past, and a gait_table does not: choose one"
        )
    if scene.gait_table and not isinstance(scene.load, scene_loads.Tripod | scene_loads.MeasuredWalk):
        return strict_yaml.Problem("gait_table", "is for walks: tripod or measured_walk")
    for n, stand in enumerate(scene.load.stands if isinstance(scene.load, scene_loads.Tripod) else ()):
        if stand.until_s <= stand.from_s:
            return strict_yaml.Problem(f"load.stands[{n}].until_s", "must be later than from_s")
    for n, fault in enumerate(scene.faults):
        until_s = getattr(fault, "until_s", None)
        if until_s is not None and until_s <= fault.at_s:
            return strict_yaml.Problem(f"faults[{n}].until_s", "must be later than at_s")
    return None


def _too_low(scene: Scene) -> strict_yaml.Problem | None:
    """Return the first force that leans more than the response table covers."""
    forces: dict[str, scene_loads.Pressing] = {}
    if isinstance(scene.load, scene_loads.Constant):
        forces = {"load.force_n": scene.load.force_n}
    elif isinstance(scene.load, scene_loads.CalibrationLoads) and not isinstance(scene.load.presses, str):
        forces = {f"load.presses[{n}]": force_n for n, force_n in enumerate(scene.load.presses)}
    for path, (x, y, z) in forces.items():
        elevation_deg = math.degrees(math.atan2(z, math.hypot(x, y)))
        if elevation_deg < LOWEST_ELEVATION_DEG:
            return strict_yaml.Problem(
                path,
                f"leans to an elevation of {elevation_deg:.0f} deg; "
                f"the foot's response is known from {LOWEST_ELEVATION_DEG} deg up",
            )
    return None
