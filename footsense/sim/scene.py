"""A scene: motion, loads, effects and faults of a simulated robot, as a YAML file.

An effect that a scene does not name is not computed. Named scenes are in `footsense/sim/scenes`.
"""

import dataclasses
import math
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from footsense import strict_yaml
from footsense.errors import ConfigError
from footsense.sim import scene_loads
from footsense.sim.faults.scene_faults import FORMER_FAULTS, Fault, Leg
from footsense.sim.foot.fabrication import PAPER_TOLERANCES, REMOUNT_DEG, FootTolerances

#: Lowest elevation of a contact [deg].
LOWEST_ELEVATION_DEG = 30


class _Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A strict part of a scene."""


class Fabrication(_Part, frozen=True):
    """Deviations of the feet from their design: rms values, as in `fabrication.FootTolerances`.

    Attributes:
        seed: Seed of the deviations.
        first: Number of the foot on the first leg; the other legs have the next ones.
        gap_um: Rms deviation of the gap of each element [um].
        film_um: Rms deviation of the film of each element [um].
        stray_pf: Rms stray of each element [pF].
        stiffness_rel: Rms deviation of the stiffness of the whole foot [1].
        mount_deg: Rotation of a foot on its leg [deg].
        remount_deg: Rotation added at each mounting [deg].
        mounting: Number of the mounting.
    """

    seed: Annotated[int, Meta(ge=0)] = 1
    first: Annotated[int, Meta(ge=0)] = 0
    gap_um: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    film_um: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    stray_pf: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.0
    stiffness_rel: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0
    mount_deg: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    remount_deg: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    mounting: Annotated[int, Meta(ge=0)] = 0

    @classmethod
    def with_paper_tolerances(cls, *, seed: int, first: int, mounting: int) -> "Fabrication":
        """Return feet with the paper's fabrication tolerances, in one of their mountings."""
        rms = dataclasses.asdict(PAPER_TOLERANCES)
        return cls(seed=seed, first=first, mounting=mounting, remount_deg=REMOUNT_DEG, **rms)

    @property
    def tolerances(self) -> FootTolerances:
        """The rms values of the deviations."""
        rms = dataclasses.fields(FootTolerances)
        return FootTolerances(**{field.name: getattr(self, field.name) for field in rms})


class _Gradual(_Part, frozen=True):
    """A linear change over time.

    Attributes:
        from_s: Start [s].
        over_s: Duration [s].
    """

    from_s: Annotated[float, Meta(ge=0.0)]
    over_s: Annotated[float, Meta(gt=0.0)]

    def share(self, t_ns: int) -> float:
        """Return the share of the change that has happened by a time [1]."""
        return min(max((t_ns / 1e9 - self.from_s) / self.over_s, 0.0), 1.0)


class Warming(_Gradual, frozen=True, kw_only=True):
    """A change of temperature.

    Attributes:
        kelvin: Change in the end [K].
    """

    kelvin: Annotated[float, Meta(ge=-60.0, le=60.0)]

    def kelvin_at(self, t_ns: int) -> float:
        """Return the change by a time [K]."""
        return self.kelvin * self.share(t_ns)


class Softening(_Gradual, frozen=True, kw_only=True):
    """One foot that becomes softer than the others: rubber that ages, or a sheet that comes off.

    Attributes:
        leg: Leg of the foot.
        softer_rel: Increase of its closures in the end, under the same load [1]; below 0 it hardens.
    """

    leg: Leg
    softer_rel: Annotated[float, Meta(ge=-0.5, le=0.5)]

    def softness(self, t_ns: int) -> float:
        """Return closures at a time over those at the begin, under the same load [1]."""
        return 1.0 + self.softer_rel * self.share(t_ns)


class Effects(_Part, frozen=True):
    """Deviations of the robot from the ideal.

    Attributes:
        converter_noise: Whether conversions have white noise, by rate.
        converter_clock_rel: Largest deviation of a converter's clock; each chip draws its own [1].
        stray_pf: Capacitance to ground in parallel with every element [pF].
        gap_contact: Whether a closed gap carries load; else its closure is only limited.
        rubber: Whether the feet creep and show hysteresis (`sim/foot/viscoelastic.py`).
        warming: Change of temperature; None for none.
        softening: Ageing of one foot; None for none.
        adapter_timeout_ms: Timeout of an I2C adapter for a held line; 1000 where it cannot be set [ms].
    """

    converter_noise: bool = False
    converter_clock_rel: Annotated[float, Meta(ge=0.0, le=0.1)] = 0.0
    stray_pf: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    gap_contact: bool = False
    rubber: bool = False
    warming: Warming | None = None
    softening: Softening | None = None
    adapter_timeout_ms: Annotated[float, Meta(ge=10.0, le=10_000.0)] = 20.0


class Scene(_Part, frozen=True):
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
    if isinstance(scene.load, scene_loads.Constant | scene_loads.Ramp):
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
