"""Soak test: robots of the judging gaits walk on made and worn feet, with faults, commands, restarts and clock steps.

Everything runs in virtual time and follows from the seed, so that a stretch with a violation can be repeated alone. A
stretch is six minutes of one robot in one gait on one draw of feet, in three lives of the service: the first begins
with the feet in the air, the others with a robot that stands, and have to tare each foot in its next swing.
"""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import msgspec
import numpy as np

from footsense.clock import stopwatch_ns, wall_time_ns
from footsense.config import DEFAULT, SMALL_BOARD, Config
from footsense.daemon.scheduling import resident_mib
from footsense.daemon.service import open_service
from footsense.daemon.simulation import simulated_robot
from footsense.daemon.walker_scene import judging_scene
from footsense.foot.parameters import FootParameters
from footsense.foot.specimen import Deviations, Specimen
from footsense.frames import ELEMENTS, IS_USABLE_STATE, Cycle, Vector
from footsense.ports import Observer
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.records import NumberedCycle
from footsense.sim.fabrication import draw_deviations, with_new_mounting
from footsense.sim.faults.scene_faults import CanTraffic
from footsense.sim.scene import Fabrication, Scene
from footsense.validation.controller import Controller
from footsense.validation.invariants import InvariantChecker, Violation
from footsense.validation.known_feet import write_known
from footsense.validation.soak_faults import soak_faults
from footsense.validation.tolerances import WalkLimits

#: Length of a stretch [h], lives of the service in it, and time in the air before the first [s].
STRETCH_H, _N_LIVES, _LEAD_IN_S = 0.1, 3, 1.0
#: Robots by foot type, with the legs of each.
_LEGS = {
    "hexapod-2kg": ("lf", "lm", "lr", "rf", "rm", "rr"),
    "quadruped-12kg": ("lf", "lr", "rf", "rr"),
}
#: Conditions of feet, one stretch after the other.
FEET = ("made", "worn", "designed")
#: One stretch in so many has boards with an FDC1004.
_FDC1004_EVERY = 4
#: Share of the stretches in which every force goes to CAN [1].
_EVERY_FORCE_REL = 0.3
#: Creep of single elements beside the foot's, and gains of a worn foot [1]: elements of a measured insole creep apart
#: by 0.4 of their mean creep, which is 7 % of rubber; its gains are 1.2 to 2.6 % off in later sessions.
_CREEP_SPREAD_REL, _GAIN_REL = 0.03, 0.025
#: Rare frames of another node, with the lowest priority: CAN is simulated only with traffic or faults on it.
_IDLE_TRAFFIC = CanTraffic(at_s=0.0, can_id=0x7FF, rate_hz=0.1)
#: Time without faults at the begin and the end of a life [s].
_CALM_S = 3.0
#: Steps of the wall clock in a life, and the largest [s].
_N_CLOCK_STEPS, _LARGEST_STEP_S = 4, 86_400.0
_NS_PER_S = 1_000_000_000


class Stretch(msgspec.Struct, frozen=True, kw_only=True):
    """Part of the soak test, run by one process: a robot in a gait, on made feet.

    Attributes:
        number: Index in the soak.
        seed: Seed of the soak.
        hours: Duration [h].
        foot_type: Foot type of the robot.
        board: Its board.
        feet: Condition of its feet, of `FEET`.
        walk: Number of its walk, as of `judging_scene`.
        publish_every: Frames of readings per force on CAN; None for the usual.
    """

    number: int
    seed: int
    hours: float
    foot_type: str
    board: str
    feet: str
    walk: int
    publish_every: int | None

    @property
    def config(self) -> Config:
        """The robot."""
        robot = SMALL_BOARD if self.board == SMALL_BOARD.board else DEFAULT
        legs = _LEGS[self.foot_type]
        buses = tuple(
            msgspec.structs.replace(
                bus,
                legs={leg: channel for leg, channel in bus.legs.items() if leg in legs},
                addresses={leg: address for leg, address in bus.addresses.items() if leg in legs},
            )
            for bus in robot.buses
        )
        fast = msgspec.structs.replace(robot.can, bitrate=1_000_000)
        return msgspec.structs.replace(
            robot,
            foot_type=self.foot_type,
            buses=buses,
            publish_every=self.publish_every,
            can=fast if self.publish_every else robot.can,
        )

    @property
    def scene(self) -> Scene:
        """What it goes through but for the faults.

        Raises:
            ConfigError: There is no MuJoCo, in which the robot walks.
        """
        scene = judging_scene(self.foot_type, self.walk)
        effects, fabrication = scene.effects, None
        if self.feet != "designed":
            fabrication = Fabrication.with_paper_tolerances(
                seed=1000 + self.seed, first=8 * self.number, mounting=1
            )
        if self.feet == "worn" and fabrication is not None:
            effects = msgspec.structs.replace(effects, rubber=True, creep_spread_rel=_CREEP_SPREAD_REL)
            fabrication = msgspec.structs.replace(fabrication, mounting=2, gain_rel=_GAIN_REL, session=1)
        return msgspec.structs.replace(
            scene,
            gait_table=True,
            seed=1000 * self.seed + self.number,
            effects=effects,
            fabrication=fabrication,
        )

    def with_feet(self, scene: Scene, folder: Path) -> Config:
        """Return the robot and what it goes through, with calibrated feet.

        Args:
            scene: As of `scene`.
            folder: Folder for the calibrations.
        """
        if (made := scene.fabrication) is None:
            return self.config
        in_the_air = msgspec.structs.replace(scene, gait_table=False, lead_in_s=_LEAD_IN_S)
        robot = simulated_robot(self.config, in_the_air)
        with open_service(self.config, in_the_air, real_time=False) as service:
            free = _FreeReadings()
            service.observers.append(free)
            service.run(until_ns=0.5 * _LEAD_IN_S * _NS_PER_S)
        feet = {leg: f"foot-{number:04}" for number, leg in enumerate(self.config.legs)}
        for number, leg in enumerate(self.config.legs):
            read_pf = free.capacitance_pf[number]
            own = draw_deviations(robot.feet[leg].response, made.tolerances, made.seed, made.first + number)
            own = with_new_mounting(own, made.remount_deg, made.seed, made.first + number, 1)
            _calibrate(robot.feet[leg], own, read_pf, folder, feet[leg])
        return msgspec.structs.replace(self.config, feet=feet, calibrations=str(folder))


class _FreeReadings(Observer):
    """Observer that keeps the latest readings."""

    def observe(self, cycle: Cycle) -> None:
        """Keep the readings of a cycle."""
        self.capacitance_pf = cycle.scan.capacitance_pf


def _calibrate(foot: Specimen, own: Deviations, read_pf: Vector, folder: Path, name: str) -> None:
    """Write the calibration of a foot before its wear, with the parameters that it was made with.

    Its converter has read it free, with the gain of its reference capacitor [pF]. It is so old that sigma has the wear.
    """
    gain_rel = float((read_pf / foot.unloaded_pf).mean())
    parameters = FootParameters(
        stray_pf=gain_rel * foot.stray_pf,
        unloaded_pf=gain_rel * foot.unloaded_pf,
        gap_um=foot.gap_um,
        gain_rel=np.full(ELEMENTS, 1.0 / gain_rel),
        stiffness_rel=own.stiffness_rel,
        mount=own.mount,
    )
    response = foot.response
    write_known(folder, name, response.foot_type, parameters, "2000-01-01T00:00:00Z", response.sha256)


def soak_stretches(hours: float, seed: int) -> list[Stretch]:
    """Return the stretches of a soak test, of six minutes each; every choice follows from the seed."""
    n = max(round(hours / STRETCH_H), 1)
    rng = np.random.default_rng(seed)
    return [
        Stretch(
            number=number,
            seed=seed,
            hours=hours / n,
            foot_type=tuple(_LEGS)[number % len(_LEGS)],
            board="fdc1004" if (number + seed) % _FDC1004_EVERY == 0 else "ad7147",
            feet=FEET[(number + seed) % len(FEET)],
            walk=int(rng.integers(1000)),
            publish_every=1 if rng.random() < _EVERY_FORCE_REL else None,
        )
        for number in range(n)
    ]


class StretchResult(msgspec.Struct, frozen=True, kw_only=True):
    """Result of one stretch of the soak test.

    Attributes:
        stretch: The stretch.
        walk: Robot, gait and ground, in words.
        virtual_s: Virtual time [s].
        wall_s: Computing time [s].
        n_faults: Faults in it.
        n_commands: Commands of the controller.
        n_answers: Answers to them.
        n_cycles: Cycles of the loop.
        usable_share: Share of the forces of the legs that were usable [1].
        within_2_sigma: Share of the components of usable forces within two sigma [1].
        n_violations: Violations by invariant.
        first_violations: The first violations of each life; times are from the begin of the stretch.
        longest_cycle_interval_s: Longest time between two cycles [s].
        n_missed_force_frames: Frames of `Force` that were lost while CAN was broken.
        resident_mib: Memory after each life [MiB].
        growth_mib: Largest growth of memory within a life, after its first quarter [MiB].
    """

    stretch: Stretch
    walk: str
    virtual_s: float
    wall_s: float
    n_faults: int
    n_commands: int
    n_answers: int
    n_cycles: int
    usable_share: float
    within_2_sigma: float
    n_violations: dict[str, int]
    first_violations: list[Violation]
    longest_cycle_interval_s: float
    n_missed_force_frames: int
    resident_mib: list[float]
    growth_mib: float

    @property
    def line(self) -> str:
        """The result as a line of text."""
        stretch = self.stretch
        every = " every force on CAN," if stretch.publish_every else ""
        return (
            f"stretch {stretch.number}: {self.walk}; {stretch.feet} feet, {stretch.board},{every} "
            f"{self.n_faults} faults, {self.n_commands} commands, {sum(self.n_violations.values())} violations; "
            f"{self.usable_share:.1%} usable, {self.within_2_sigma:.1%} within 2 sigma, "
            f"{self.virtual_s / self.wall_s:.1f} x real time"
        )


class _Life(msgspec.Struct, frozen=True, kw_only=True):
    """What one life of the service within a stretch leaves."""

    n_faults: int
    checks: InvariantChecker
    controller: Controller
    resident_mib: tuple[float, float]


def walk_stretch(stretch: Stretch) -> StretchResult:
    """Simulate one stretch of the soak test; return counts, violations and errors.

    Raises:
        ConfigError: There is no MuJoCo, in which the robot walks.
        ModelError: The released network, the response table or the fault table is missing.
    """
    life_s = 3600.0 * stretch.hours / _N_LIVES
    began_ns = stopwatch_ns()
    with TemporaryDirectory() as folder:
        ring = str(Path(folder) / "ring")
        scene = stretch.scene
        try:
            robot = stretch.with_feet(scene, Path(folder) / "feet")
            config = msgspec.structs.replace(robot, ring=ring)
            lives = [_live(stretch, config, scene, number, life_s) for number in range(_N_LIVES)]
        except Exception as error:
            error.add_note(f"in stretch {stretch.number}")
            raise
    checks = [life.checks for life in lives]
    states = sum((of_life.n_states for of_life in checks), Counter[int]())
    n_checked = sum(of_life.n_checked for of_life in checks)
    violations = [
        violation._replace(t_s=round(number * life_s + violation.t_s, 4))
        for number, of_life in enumerate(checks)
        for violation in of_life.violations
    ]
    n_violations = sum((of_life.n_violations for of_life in checks), Counter[str]())
    return StretchResult(
        stretch=stretch,
        walk=scene.description.partition(", repeated")[0],
        virtual_s=_N_LIVES * life_s,
        wall_s=(stopwatch_ns() - began_ns) / _NS_PER_S,
        n_faults=sum(life.n_faults for life in lives),
        n_commands=sum(life.controller.n_commands for life in lives),
        n_answers=sum(life.controller.n_answers for life in lives),
        n_cycles=sum(of_life.n_cycles for of_life in checks),
        usable_share=sum(n for state, n in states.items() if IS_USABLE_STATE[state]) / states.total(),
        within_2_sigma=sum(of_life.n_within for of_life in checks) / max(3 * n_checked, 1),
        n_violations=dict(n_violations),
        first_violations=violations,
        longest_cycle_interval_s=max(of_life.longest_gap_s for of_life in checks),
        n_missed_force_frames=sum(of_life.n_missed for of_life in checks),
        resident_mib=[round(life.resident_mib[1], 1) for life in lives],
        growth_mib=max(late_mib - early_mib for early_mib, late_mib in (life.resident_mib for life in lives)),
    )


def _live(stretch: Stretch, config: Config, scene: Scene, number: int, until_s: float) -> _Life:
    """Run one life of the service up to a time [s]; return what it leaves."""
    rng = np.random.default_rng((stretch.seed, stretch.number, number))
    script = soak_faults(rng, config, _CALM_S, until_s - _CALM_S)
    lead_in_s = 0.0 if number else _LEAD_IN_S
    scene = msgspec.structs.replace(scene, lead_in_s=lead_in_s, faults=(_IDLE_TRAFFIC, *script))
    with open_service(config, scene, real_time=False) as service:
        true_force_n_at, can = service.true_force_n_at, service.simulated_can
        assert true_force_n_at is not None, "a scene is simulated"
        assert can is not None, "the scene has traffic on CAN"
        rules = WalkLimits.of(config, true_force_n_at, until_s)
        checks = InvariantChecker(rules, script, true_force_n_at)
        controller = Controller(can, config.legs, true_force_n_at, rng)

        def on_delivered(t_ns: int, queued_ns: int, frame: bytes) -> None:
            checks.on_delivered(t_ns, queued_ns, frame)
            controller.hear(frame, t_ns)

        can.controller.on_delivered = on_delivered
        service.observers += [checks, controller]
        mib = []
        for end_s in np.linspace(0.0, until_s, _N_CLOCK_STEPS + 1)[1:].tolist():
            with _wall_clock_off_by(float(rng.uniform(-_LARGEST_STEP_S, _LARGEST_STEP_S))):
                service.run(until_ns=end_s * _NS_PER_S)
            mib.append(resident_mib())
        checks.end(
            until_s,
            unanswered=controller.unanswered(round(until_s * _NS_PER_S)),
            ring_problem=_ring_problem(config, checks),
            grown_mib=mib[-1] - mib[0],
        )
    return _Life(n_faults=len(script), checks=checks, controller=controller, resident_mib=(mib[0], mib[-1]))


@contextmanager
def _wall_clock_off_by(step_s: float) -> Iterator[None]:
    """Set the wall clock of this process off by a time [s] during a `with` block."""
    wall_ns, began_ns = wall_time_ns() + round(step_s * _NS_PER_S), stopwatch_ns()

    def stepped_ns() -> int:
        return wall_ns + stopwatch_ns() - began_ns

    with mock.patch("time.time_ns", stepped_ns):
        yield


def _ring_problem(config: Config, checks: InvariantChecker) -> str:
    """Return what is wrong with the cycles of the last second in a service's ring; empty for nothing."""
    reader = CycleReader(config.ring_path)
    cycles = [entry for entry in reader.read() if isinstance(entry, NumberedCycle)]
    reader.close()
    numbers = [cycle.cycle_number for cycle in cycles]
    if numbers == list(range(checks.n_cycles - len(numbers), checks.n_cycles)) and numbers:
        return ""
    return f"{len(numbers)} cycles, the last {numbers[-1:]} of {checks.n_cycles}"
