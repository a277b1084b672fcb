"""A scene: what a simulated robot does and which effects are on, as a YAML file.

An effect that a scene does not name is not computed. Named scenes are in `footsense/sim/scenes`.
"""

import math
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from footsense import strict_yaml
from footsense.errors import ConfigError
from footsense.frames import LEGS
from footsense.sim.faults.scene_faults import FORMER_FAULTS, Fault, Leg
from footsense.sim.foot.fabrication import AS_BADLY_MADE, REMOUNT_DEG, FootTolerances
from footsense.sim.loads import ground_load
from footsense.sim.test_stand.press_sequence import PressSequence, paper_presses

_NS_PER_S = 1_000_000_000
#: Lowest elevation of a contact [deg].
LOWEST_ELEVATION_DEG = 30

Force = Annotated[float, Meta(ge=0.0, le=2.0)]
Pitch = Annotated[float, Meta(ge=-30.0, le=30.0)]
_Pressing = tuple[float, float, Annotated[float, Meta(gt=0.0, le=2.0)]]


class _Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A strict part of a scene."""


class Unloaded(_Part, frozen=True, tag="unloaded", tag_field="kind"):
    """All feet in the air."""

    def build(self, from_ns: int) -> ground_load.Load:
        """Return the load."""
        del from_ns
        return ground_load.Unloaded()


class Constant(_Part, frozen=True, tag="constant", tag_field="kind"):
    """One force on every foot, through the centre of its ball."""

    force_n: _Pressing

    def build(self, from_ns: int) -> ground_load.Load:
        """Return the load."""
        return ground_load.Ramp(self.force_n, from_ns)


class Ramp(_Part, frozen=True, tag="ramp", tag_field="kind"):
    """One force on every foot, through the centre of its ball, that grows evenly from nothing."""

    force_n: _Pressing
    rise_s: Annotated[float, Meta(gt=0.0, le=60.0)]

    def build(self, from_ns: int) -> ground_load.Load:
        """Return the load."""
        return ground_load.Ramp(self.force_n, from_ns, round(self.rise_s * _NS_PER_S))


class Stand(_Part, frozen=True):
    """A time in which the robot stands: from the middle of each leg's next stance on, for whole gait cycles."""

    from_s: Annotated[float, Meta(ge=0.0)]
    until_s: Annotated[float, Meta(gt=0.0)]


class Tripod(_Part, frozen=True, tag="tripod", tag_field="kind"):
    """A tripod gait with rounded stances, and the times in which it stops, in their order."""

    period_s: Annotated[float, Meta(ge=0.1, le=10.0)]
    duty_rel: Annotated[float, Meta(gt=0.0, lt=1.0)]
    peak_force_n: Force
    friction_rel: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0
    pitch_deg: Pitch = 0.0
    stands: tuple[Stand, ...] = ()

    def build(self, from_ns: int) -> ground_load.Walk:
        """Return the load."""
        reaction = ground_load.smooth_step(self.duty_rel, self.peak_force_n, self.friction_rel)
        return ground_load.Walk(
            dict.fromkeys(LEGS, reaction),
            period_ns=round(self.period_s * _NS_PER_S),
            duty_rel=self.duty_rel,
            pitch_deg=self.pitch_deg,
            from_ns=from_ns,
            stands_ns=[
                (round(stand.from_s * _NS_PER_S), round(stand.until_s * _NS_PER_S)) for stand in self.stands
            ],
        )


class MeasuredWalk(_Part, frozen=True, tag="measured_walk", tag_field="kind"):
    """A tripod gait whose legs feel the measured ground reactions of a walking person, scaled."""

    peak_force_n: Force
    pitch_deg: Pitch = 0.0

    def build(self, from_ns: int) -> ground_load.Load:
        """Return the load."""
        return ground_load.measured_walk(self.peak_force_n, self.pitch_deg, from_ns)


#: Words of earlier versions of `CalibrationLoads`, each with what replaces it.
_FORMER_LOADS = {
    "pokes": "now called calibration_loads",
    "hold_s": "now called dwell_s",
    "rest_s": "now called pause_s",
}


class CalibrationLoads(_Part, frozen=True, tag="calibration_loads", tag_field="kind"):
    """Presses of all feet through the centre of the ball, one after the other, as on a test stand.

    Attributes:
        presses: The forces [N]; or the paper's: `training`, 362, or `verification`, 180.
        rise_s: Duration of a force's rise, and of its fall [s].
        dwell_s: Duration of the constant force [s].
        pause_s: Time without load before the next press [s].
        lean_deg: Root mean square angle between the contact's normal and the force [deg].
        seed: Seed of these angles.
    """

    presses: Literal["training", "verification"] | Annotated[tuple[_Pressing, ...], Meta(min_length=1)]
    rise_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.1
    dwell_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 0.6
    pause_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 0.4
    lean_deg: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    seed: Annotated[int, Meta(ge=0)] = 1

    def build(self, from_ns: int) -> PressSequence:
        """Return the load."""
        return PressSequence(
            paper_presses(self.presses) if isinstance(self.presses, str) else self.presses,
            from_ns=from_ns,
            rise_ns=round(self.rise_s * _NS_PER_S),
            dwell_ns=round(self.dwell_s * _NS_PER_S),
            pause_ns=round(self.pause_s * _NS_PER_S),
            lean_deg=self.lean_deg,
            seed=self.seed,
        )


class Fabrication(_Part, frozen=True):
    """Feet that are not as designed: rms values of what each is off by, as in `fabrication.FootTolerances`.

    Attributes:
        seed: Of the workshop.
        first: Number of the foot on the first leg; the other legs have the next ones.
        gap_um: Of the gap of each element [um].
        film_um: Of the film of each element [um].
        stray_pf: Of the stray of each element [pF].
        stiffness_rel: Of the stiffness of the whole foot [1].
        mount_deg: Angle by which a foot is turned on its leg [deg].
        remount_deg: Angle by which it is turned besides each time that it is put on [deg].
        mounting: Which time that is.
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
    def as_badly_made(cls, *, seed: int, first: int, mounting: int) -> "Fabrication":
        """Return feet of the paper's quality, put on once more."""
        rms = {name: getattr(AS_BADLY_MADE, name) for name in FootTolerances.__dataclass_fields__}
        return cls(seed=seed, first=first, mounting=mounting, remount_deg=REMOUNT_DEG, **rms)

    @property
    def tolerances(self) -> FootTolerances:
        """The same as the workshop has it."""
        return FootTolerances(
            gap_um=self.gap_um,
            film_um=self.film_um,
            stray_pf=self.stray_pf,
            stiffness_rel=self.stiffness_rel,
            mount_deg=self.mount_deg,
        )


class Warming(_Part, frozen=True):
    """A temperature that changes evenly, and what that does to a foot.

    Attributes:
        from_s: When it begins [s].
        over_s: How long it takes [s].
        kelvin: By how much [K].
    """

    from_s: Annotated[float, Meta(ge=0.0)]
    over_s: Annotated[float, Meta(gt=0.0)]
    kelvin: Annotated[float, Meta(ge=-60.0, le=60.0)]

    def kelvin_at(self, t_ns: int) -> float:
        """Return how much warmer it is than at the beginning [K]."""
        return self.kelvin * min(max((t_ns / _NS_PER_S - self.from_s) / self.over_s, 0.0), 1.0)


class Softening(_Part, frozen=True):
    """One foot that becomes softer than the others, evenly: rubber that ages, or a sheet that comes off.

    Attributes:
        leg: Which.
        from_s: When it begins [s].
        over_s: How long it takes [s].
        softer_rel: By how much its closures are larger in the end, under the same load [1]; below 0 it hardens.
    """

    leg: Leg
    from_s: Annotated[float, Meta(ge=0.0)]
    over_s: Annotated[float, Meta(gt=0.0)]
    softer_rel: Annotated[float, Meta(ge=-0.5, le=0.5)]

    def softness(self, t_ns: int) -> float:
        """Return its closures over those that it had at the beginning, under the same load [1]."""
        return 1.0 + self.softer_rel * min(max((t_ns / _NS_PER_S - self.from_s) / self.over_s, 0.0), 1.0)


class Effects(_Part, frozen=True):
    """What is not ideal.

    Attributes:
        converter_noise: White noise of every conversion, by rate.
        converter_clock_rel: Largest deviation of a converter's clock; each chip draws its own [1].
        stray_pf: Capacitance to ground in parallel with every element [pF].
        gap_contact: Whether a gap that shuts carries load; else its closure is only limited.
        rubber: Whether the feet creep and show hysteresis (`sim/foot/viscoelastic.py`).
        warming: How the temperature changes; None for not at all.
        softening: How one foot ages; None for not at all.
        adapter_timeout_ms: How long an I2C adapter waits for a line that is held; those that cannot be told wait
            1000 [ms].
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
    """What a simulated robot does.

    Attributes:
        description: One line for the reader.
        load: What the ground does.
        lead_in_s: Time before the load begins, all feet in the air: the feet are tared in it [s].
        host_cost_us: What the host adds to every I2C transaction [us].
        seed: Of everything random.
        gait_table: Whether what a foot does over a gait cycle is computed once and interpolated, for long walks:
            0.2 fF off as long as no gap shuts.
        effects: What is not ideal.
        fabrication: What the feet are like; None for feet as designed.
        faults: What breaks, and when.
    """

    description: str
    load: Unloaded | Constant | Ramp | Tripod | MeasuredWalk | CalibrationLoads
    lead_in_s: Annotated[float, Meta(ge=0.0)] = 1.0
    host_cost_us: Annotated[float, Meta(ge=0.0, le=10_000.0)] = 0.0
    seed: Annotated[int, Meta(ge=0)] = 1
    gait_table: bool = False
    effects: Effects = Effects()
    fabrication: Fabrication | None = None
    faults: tuple[Fault, ...] = ()


def scene_names() -> list[str]:
    """Return the names of the scenes that come with footsense."""
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
    return strict_yaml.load(source, Scene, where, check=_contradiction, former=FORMER_FAULTS | _FORMER_LOADS)


def _contradiction(scene: Scene) -> strict_yaml.Problem | None:
    """Return what is right by itself and cannot be simulated."""
    if (problem := _too_low(scene)) is not None:
        return problem
    if scene.gait_table and scene.effects.rubber:
        return strict_yaml.Problem("effects.rubber", "remembers, and a gait_table does not: choose one")
    if scene.gait_table and not isinstance(scene.load, Tripod | MeasuredWalk):
        return strict_yaml.Problem("gait_table", "is for walks: tripod or measured_walk")
    for n, stand in enumerate(scene.load.stands if isinstance(scene.load, Tripod) else ()):
        if stand.until_s <= stand.from_s:
            return strict_yaml.Problem(f"load.stands[{n}].until_s", "must be later than from_s")
    for n, fault in enumerate(scene.faults):
        until_s = getattr(fault, "until_s", None)
        if until_s is not None and until_s <= fault.at_s:
            return strict_yaml.Problem(f"faults[{n}].until_s", "must be later than at_s")
    return None


def _too_low(scene: Scene) -> strict_yaml.Problem | None:
    """Return which force leans more than the foot's response is known for."""
    forces: dict[str, _Pressing] = {}
    if isinstance(scene.load, Constant | Ramp):
        forces = {"load.force_n": scene.load.force_n}
    elif isinstance(scene.load, CalibrationLoads) and not isinstance(scene.load.presses, str):
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
