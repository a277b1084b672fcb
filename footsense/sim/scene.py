"""Scenes: load, faults and effects of a simulated robot, and fabrication of its feet, from YAML files.

An effect that a scene does not name is not computed.
"""

import dataclasses
import math
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from footsense import strict_yaml
from footsense.errors import ConfigError
from footsense.sim import scene_loads
from footsense.sim.couplings import Couplings
from footsense.sim.fabrication import PAPER_TOLERANCES, REMOUNT_RMS_DEG, FootTolerances
from footsense.sim.faults.scene_faults import Fault
from footsense.sim.loads.ground_load import MIN_ELEVATION_DEG

#: Rubber as assumed, three times of that, or as a measured insole's foam.
RubberLevel = Literal["assumed", "threefold", "insole"]


class ScenePart(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base class of the parts of a scene file; unknown keys are errors."""


class Warming(ScenePart, frozen=True):
    """A linear change of the temperature of all feet.

    Attributes:
        from_s: Start [s].
        over_s: Duration [s].
        kelvin: Change in the end [K].
    """

    from_s: Annotated[float, Meta(ge=0.0)]
    over_s: Annotated[float, Meta(gt=0.0)]
    kelvin: Annotated[float, Meta(ge=-60.0, le=60.0)]

    def temperature_change_k_at(self, t_ns: int) -> float:
        """Return the temperature change at a time [K]."""
        return self.kelvin * min(max((t_ns / 1e9 - self.from_s) / self.over_s, 0.0), 1.0)


class Ad7147Effects(ScenePart, frozen=True):
    """Deviations of AD7147 converters, and behaviour that no source states; each combination is a kind of chip.

    Attributes:
        noise_ff: Noise of a conversion at decimation 64, where converters have noise [fF rms].
        gain_rel: Largest deviation of the gain, common to a chip's inputs; each chip draws its own [1].
        offset_rel: Largest deviation of the steps of the offset; each chip draws its own [1].
        coherent_bursts: Whether all registers of a read are as at its start, instead of each as at its own time.
        torn_words: Whether a result that turns new within its word is half old and half new.
        complete_needs_enable: Whether a stage's status bit is set only where its enable bit is.
        junk_sequences: Sequences after a new configuration whose results are not to be used.
        calibration_moves_results: Whether the calibration engine, where it is on, moves results to the middle.
        shifted_burst_rel: Probability that a read of several registers begins one register late [1].
    """

    noise_ff: Annotated[float, Meta(ge=0.0, le=100.0)] = 1.0
    gain_rel: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0
    offset_rel: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0
    coherent_bursts: bool = False
    torn_words: bool = False
    complete_needs_enable: bool = False
    junk_sequences: Annotated[int, Meta(ge=0, le=2)] = 1
    calibration_moves_results: bool = False
    shifted_burst_rel: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0


class Effects(ScenePart, frozen=True):
    """Simulated deviations of the robot from the ideal: noise, clock errors, rubber, temperature.

    Attributes:
        converter_noise: Whether conversions have white noise, by rate.
        converter_clock_rel: Largest deviation of a converter's clock; each chip draws its own [1].
        common_noise_rel: Share of the variance of that noise that changes slowly, and that all channels of a leg have
            in common [1]; 0.8 was seen of a scanned rubber sensor (18 unloaded recordings of CoinFT-TRACE).
        trigger_clears_done: Whether a FDC1004 forgets that a conversion was done when the next one is started.
        done_needs_both_reads: Whether it forgets that only after both registers of the result have been read, instead
            of the upper one alone.
        keeps_old_result: Whether a result of a FDC1004 that is being converted still reads as the old one.
        ad7147: What kind of chips AD7147 are.
        stray_pf: Capacitance to ground in parallel with every element [pF].
        couplings: What lies beside the measured lines, as the foot type's table has it; None for nothing. Board `mcu`
            has none.
        gap_contact: Whether a closed gap carries load; else its closure is only limited.
        rubber: Whether the feet creep and show hysteresis (`sim/rubber.py`).
        rubber_level: How much: as assumed, three times as much, or as a measured insole's foam (page `real-sensors`).
        creep_spread_rel: Standard deviation of the creep of single elements beside that of the foot [1].
        floor_pf: Capacitance that the floor adds to each element of a foot in contact, at most [pF]; each has 0.7 to 1
            of it.
        warming: Change of temperature; None for none.
        adapter_compares: Whether an I2C adapter compares SDA with what it sends, and times out where it is held; that
            of a Raspberry Pi 0 to 4 does not.
        adapter_timeout_ms: Timeout of an I2C adapter for a held line; 1000 where it cannot be set [ms].
    """

    converter_noise: bool = False
    converter_clock_rel: Annotated[float, Meta(ge=0.0, le=0.1)] = 0.0
    common_noise_rel: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    trigger_clears_done: bool = False
    done_needs_both_reads: bool = False
    keeps_old_result: bool = False
    ad7147: Ad7147Effects = Ad7147Effects()
    stray_pf: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    couplings: Couplings | None = None
    gap_contact: bool = False
    rubber: bool = False
    rubber_level: RubberLevel = "assumed"
    creep_spread_rel: Annotated[float, Meta(ge=0.0, le=0.2)] = 0.0
    floor_pf: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    warming: Warming | None = None
    adapter_compares: bool = True
    adapter_timeout_ms: Annotated[float, Meta(ge=10.0, le=10_000.0)] = 20.0


#: Those of a robot that is simulated without a scene's file, and its host [us]: 40 us a transaction, clocks within 1 %.
USUAL_EFFECTS = Effects(converter_noise=True, converter_clock_rel=0.01, gap_contact=True)
USUAL_HOST_COST_US = 40.0


class Fabrication(ScenePart, frozen=True):
    """Fabrication of the simulated feet: seed, first foot, mounting, and rms deviations from the design.

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
        gain_rel: Rms deviation of the gain of each element's closure from that of session 0, drawn anew in each other
            session [1]; 0.012 to 0.038 was seen of a measured insole (page `real-sensors`).
        session: Number of the session.
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
    gain_rel: Annotated[float, Meta(ge=0.0, le=0.2)] = 0.0
    session: Annotated[int, Meta(ge=0)] = 0

    @classmethod
    def with_paper_tolerances(cls, *, seed: int, first: int, mounting: int) -> "Fabrication":
        """Return the settings of feet with the paper's fabrication tolerances, in a given mounting."""
        rms = dataclasses.asdict(PAPER_TOLERANCES)
        return cls(seed=seed, first=first, mounting=mounting, remount_deg=REMOUNT_RMS_DEG, **rms)

    @property
    def tolerances(self) -> FootTolerances:
        """The rms deviations as fabrication tolerances."""
        rms = dataclasses.fields(FootTolerances)
        return FootTolerances(**{field.name: getattr(self, field.name) for field in rms})


class Scene(ScenePart, frozen=True):
    """A scene file: load, effects, fabrication and faults of a simulated robot.

    Attributes:
        description: One line for the reader.
        load: Load of the feet.
        foot_type: Foot type that the load is made for; with another a warning says so. None: of no certain one.
        lead_in_s: Time before the load, all feet in the air: the feet are tared in it [s].
        host_cost_us: Cost of every I2C transaction on the host [us].
        seed: Seed of everything random.
        gait_table: Whether the capacitances over a gait cycle, or over a log, are computed once and interpolated, for
            long walks: 0.2 fF off as long as no gap closes.
        effects: Deviations from the ideal.
        fabrication: Deviations of the feet; None for feet as designed.
        faults: Faults.
    """

    description: str
    load: scene_loads.Load
    foot_type: str | None = None
    lead_in_s: Annotated[float, Meta(ge=0.0)] = 1.0
    host_cost_us: Annotated[float, Meta(ge=0.0, le=10_000.0)] = 0.0
    seed: Annotated[int, Meta(ge=0)] = 1
    gait_table: bool = False
    effects: Effects = Effects()
    fabrication: Fabrication | None = None
    faults: tuple[Fault, ...] = ()


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
    folder = Path(name_or_path).parent
    scene = strict_yaml.load(text_or_path, Scene, where, lambda scene: _contradiction(scene, folder))
    if isinstance(scene.load, scene_loads.LogLoads):
        return replace(scene, load=replace(scene.load, file=str(folder / scene.load.file)))
    return scene


def _contradiction(scene: Scene, folder: Path) -> strict_yaml.Problem | None:
    """Return the first contradiction between keys that are valid each for itself; None if there is none.

    Args:
        scene: The scene.
        folder: The folder of its file, beside which a log lies.
    """
    problem = (
        _missing_log(scene, folder) or _low_elevation_contradiction(scene) or _rubber_contradiction(scene)
    )
    if problem is not None:
        return problem
    walks = scene_loads.Tripod | scene_loads.MeasuredWalk | scene_loads.LogLoads
    if scene.gait_table and not isinstance(scene.load, walks):
        return strict_yaml.Problem("gait_table", "is for walks: tripod, measured_walk or log")
    if scene.gait_table and isinstance(scene.load, scene_loads.LogLoads) and scene.effects.warming:
        return strict_yaml.Problem(
            "effects.warming", "makes the rubber softer, and the gait_table of a log does not: choose one"
        )
    for n, stand in enumerate(scene.load.stands if isinstance(scene.load, scene_loads.Tripod) else ()):
        if stand.until_s <= stand.from_s:
            return strict_yaml.Problem(f"load.stands[{n}].until_s", "must be later than from_s")
    for n, fault in enumerate(scene.faults):
        until_s = getattr(fault, "until_s", None)
        if until_s is not None and until_s <= fault.at_s:
            return strict_yaml.Problem(f"faults[{n}].until_s", "must be later than at_s")
    return None


def _rubber_contradiction(scene: Scene) -> strict_yaml.Problem | None:
    """Return what contradicts creep or its level; None if nothing does."""
    for name in ("rubber", "creep_spread_rel"):
        if (
            scene.gait_table
            and not isinstance(scene.load, scene_loads.LogLoads)
            and getattr(scene.effects, name)
        ):
            return strict_yaml.Problem(
                f"effects.{name}", "depends on the past, and a gait_table does not but of a log: choose one"
            )
    if scene.effects.rubber_level != "assumed" and not scene.effects.rubber:
        return strict_yaml.Problem("effects.rubber_level", "needs rubber: true")
    return None


def _missing_log(scene: Scene, folder: Path) -> strict_yaml.Problem | None:
    """Return that the log of loads is missing; None if it is there, or none is needed."""
    if not isinstance(scene.load, scene_loads.LogLoads) or (folder / scene.load.file).exists():
        return None
    return strict_yaml.Problem(
        "load.file", f"{folder / scene.load.file}: no such file; `footsense lab walk` writes one"
    )


def _low_elevation_contradiction(scene: Scene) -> strict_yaml.Problem | None:
    """Return the first force whose elevation is below the response table's range; None if there is none."""
    forces: dict[str, scene_loads.ReactionForce] = {}
    if isinstance(scene.load, scene_loads.Constant):
        forces = {"load.force_n": scene.load.force_n}
    elif isinstance(scene.load, scene_loads.CalibrationLoads) and not isinstance(scene.load.presses, str):
        forces = {f"load.presses[{n}]": force_n for n, force_n in enumerate(scene.load.presses)}
    for path, (x, y, z) in forces.items():
        elevation_deg = math.degrees(math.atan2(z, math.hypot(x, y)))
        if elevation_deg < MIN_ELEVATION_DEG:
            return strict_yaml.Problem(
                path,
                f"leans to an elevation of {elevation_deg:.0f} deg; "
                f"the foot's response is known from {MIN_ELEVATION_DEG} deg up",
            )
    return None
