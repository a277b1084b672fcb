"""Schemas of a scene's key `load`; each builds the true load of the feet over time."""

from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from footsense.frames import ALL_LEGS
from footsense.sim.faults.scene_faults import Leg
from footsense.sim.loads import ground_load
from footsense.sim.loads.load_log import RepeatedLog
from footsense.sim.loads.press_sequence import PressSequence, paper_presses
from footsense.sim.loads.walk import SECOND_LEG_GROUP, Walk, measured_walk, smooth_stance_reaction

ForceMagnitudeN = Annotated[float, Meta(ge=0.0, le=500.0)]
Pitch = Annotated[float, Meta(ge=-30.0, le=30.0)]
#: Constant ground reaction x, y, z on a foot [N]; z presses the foot along its leg.
ReactionForce = tuple[float, float, Annotated[float, Meta(gt=0.0, le=500.0)]]


def _nanoseconds(seconds: float) -> int:
    return round(seconds * 1_000_000_000)


class _Load(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"):
    """Base class of the loads: `build` returns a load that starts at a time; before it, all feet are in the air."""


class Unloaded(_Load, frozen=True, kw_only=True, tag="unloaded"):
    """All feet stay in the air."""

    def build(self, from_ns: int) -> ground_load.ContactSource:
        """Return itself: a constant zero load."""
        del from_ns
        return self

    def contact(self, leg: str, t_ns: int) -> ground_load.GroundContact:
        """Return a contact with zero force."""
        del leg, t_ns
        return ground_load.IN_THE_AIR


class Constant(_Load, frozen=True, kw_only=True, tag="constant"):
    """The same force on every foot, through the centre of its ball, rising linearly from zero and then constant.

    Attributes:
        force_n: The force [N].
        rise_s: Duration of the rise [s].
    """

    force_n: ReactionForce
    rise_s: Annotated[float, Meta(ge=0.0, le=60.0)] = 0.0

    def build(self, from_ns: int) -> ground_load.ContactSource:
        """Return the load as a function of time, starting at `from_ns` [ns]."""
        return ground_load.RampContact(self.force_n, from_ns, _nanoseconds(self.rise_s))


class Standstill(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A standstill in a walk: from the middle of each leg's next stance on, for whole gait periods.

    Attributes:
        from_s: Start [s].
        until_s: End [s].
    """

    from_s: Annotated[float, Meta(ge=0.0)]
    until_s: Annotated[float, Meta(gt=0.0)]


class Tripod(_Load, frozen=True, kw_only=True, tag="tripod"):
    """A tripod gait with smooth stances on flat ground.

    Attributes:
        period_s: Gait period [s].
        duty_rel: Share of the period in stance [1].
        peak_force_n: Largest vertical force [N].
        friction_rel: Largest horizontal over vertical force [1].
        pitch_deg: Lean of the legs at touchdown [deg].
        stands: Stands, in the order of time.
        second: Legs that step half a period later than the others: those of the second tripod, unless stated. A trot
            of four legs has rf and lr.
    """

    period_s: Annotated[float, Meta(ge=0.1, le=10.0)]
    duty_rel: Annotated[float, Meta(gt=0.0, lt=1.0)]
    peak_force_n: ForceMagnitudeN
    friction_rel: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0
    pitch_deg: Pitch = 0.0
    stands: tuple[Standstill, ...] = ()
    second: tuple[Leg, ...] = SECOND_LEG_GROUP

    def build(self, from_ns: int) -> Walk:
        """Return the walk, starting at `from_ns` [ns]."""
        reaction = smooth_stance_reaction(self.duty_rel, self.peak_force_n, self.friction_rel)
        return Walk(
            dict.fromkeys(ALL_LEGS, reaction),
            period_ns=_nanoseconds(self.period_s),
            duty_rel=self.duty_rel,
            pitch_deg=self.pitch_deg,
            from_ns=from_ns,
            standstills_ns=[
                (_nanoseconds(stand.from_s), _nanoseconds(stand.until_s)) for stand in self.stands
            ],
            second=self.second,
        )


class MeasuredWalk(_Load, frozen=True, kw_only=True, tag="measured_walk"):
    """A tripod gait with the measured ground reaction forces of a walking person, scaled.

    Attributes:
        peak_force_n: Largest vertical force [N].
        pitch_deg: Lean of the legs at touchdown [deg].
    """

    peak_force_n: ForceMagnitudeN
    pitch_deg: Pitch = 0.0

    def build(self, from_ns: int) -> ground_load.ContactSource:
        """Return the walk, starting at `from_ns` [ns]."""
        return measured_walk(self.peak_force_n, self.pitch_deg, from_ns)


class CalibrationLoads(_Load, frozen=True, kw_only=True, tag="calibration_loads"):
    """A sequence of presses on all feet at once, through the centre of the ball, as on a test stand.

    Attributes:
        presses: The forces [N]; or the paper's: `training`, 362, or `verification`, 180.
        rise_s: Duration of a force's rise, and of its fall [s].
        dwell_s: Duration of the constant force [s].
        pause_s: Time without load before the next press [s].
        lean_deg: Root mean square angle between the contact's normal and the force [deg].
        seed: Seed of these angles.
    """

    presses: Literal["training", "verification"] | Annotated[tuple[ReactionForce, ...], Meta(min_length=1)]
    rise_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.1
    dwell_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 0.6
    pause_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 0.4
    lean_deg: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    seed: Annotated[int, Meta(ge=0)] = 1

    def build(self, from_ns: int) -> PressSequence:
        """Return the sequence of presses, starting at `from_ns` [ns]."""
        return PressSequence(
            paper_presses(self.presses) if isinstance(self.presses, str) else self.presses,
            from_ns=from_ns,
            rise_ns=_nanoseconds(self.rise_s),
            dwell_ns=_nanoseconds(self.dwell_s),
            pause_ns=_nanoseconds(self.pause_s),
            lean_deg=self.lean_deg,
            seed=self.seed,
        )


class LogLoads(_Load, frozen=True, kw_only=True, tag="log"):
    """What the feet of a robot felt, from a file of numpy arrays as `footsense lab walk` writes it, again and again.

    Attributes:
        file: The file, relative to that of the scene: `legs`, `t_s`, `force_n` and `normal`.
        peak_force_n: Force to which the log is scaled, the largest but for a thousandth of the loaded samples [N];
            None for the forces of the file.
    """

    file: Annotated[str, Meta(min_length=1)]
    peak_force_n: Annotated[float, Meta(gt=0.0, le=500.0)] | None = None

    def build(self, from_ns: int) -> RepeatedLog:
        """Return the loads, starting at `from_ns` [ns].

        Raises:
            ConfigError: The file is no log.
        """
        return RepeatedLog(Path(self.file), from_ns, self.peak_force_n)


Load = Unloaded | Constant | Tripod | MeasuredWalk | CalibrationLoads | LogLoads
