"""Load scenes by name from `footsense/sim/scenes` or from a YAML file, and check them for contradictions."""

import math
from importlib.resources import files
from pathlib import Path

from footsense import strict_yaml
from footsense.errors import ConfigError
from footsense.sim import scene_loads
from footsense.sim.scene import Scene

#: Lowest elevation of a contact [deg].
MIN_FORCE_ELEVATION_DEG = 30


def scene_names() -> list[str]:
    """Return the names of the scenes that come with the package."""
    folder = files("footsense.sim") / "scenes"
    return sorted(
        entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml")
    )


def load_scene(name_or_path: str) -> Scene:
    """Load and return a scene that comes with the package, by name, or one from a YAML file.

    Raises:
        ConfigError: There is no such scene, or it is not a valid one.
    """
    text_or_path: Path | str = Path(name_or_path)
    where = None
    if name_or_path in scene_names():
        resource = files("footsense.sim") / "scenes" / f"{name_or_path}.yaml"
        text_or_path, where = resource.read_text(encoding="utf-8"), f"scene {name_or_path}"
    elif not Path(name_or_path).suffix:
        raise ConfigError(
            f"no scene {name_or_path!r}: there are {', '.join(scene_names())}, or give the path of a YAML file"
        )
    return strict_yaml.load(
        text_or_path,
        Scene,
        where,
        check=_contradiction,
    )


def _contradiction(scene: Scene) -> strict_yaml.Problem | None:
    """Return the first contradiction between keys that are valid each for itself; None if there is none."""
    problem = _low_elevation_contradiction(scene)
    if problem is not None:
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


def _low_elevation_contradiction(scene: Scene) -> strict_yaml.Problem | None:
    """Return the first force whose elevation is below the response table's range; None if there is none."""
    forces: dict[str, scene_loads.ReactionForce] = {}
    if isinstance(scene.load, scene_loads.Constant):
        forces = {"load.force_n": scene.load.force_n}
    elif isinstance(scene.load, scene_loads.CalibrationLoads) and not isinstance(scene.load.presses, str):
        forces = {f"load.presses[{n}]": force_n for n, force_n in enumerate(scene.load.presses)}
    for path, (x, y, z) in forces.items():
        elevation_deg = math.degrees(math.atan2(z, math.hypot(x, y)))
        if elevation_deg < MIN_FORCE_ELEVATION_DEG:
            return strict_yaml.Problem(
                path,
                f"leans to an elevation of {elevation_deg:.0f} deg; "
                f"the foot's response is known from {MIN_FORCE_ELEVATION_DEG} deg up",
            )
    return None
