"""Soak test: a simulated day of walking with a fault every half minute, in stretches with one process each.

Everything runs in virtual time and follows from the seed, so that a stretch with a violation can be repeated alone.
Every stretch begins with a walk without faults, which measures the share of errors beyond 5 sigma. Even seeds walk with
an AD7147 in a foot, odd ones with an FDC1004.
"""

from collections import Counter

import msgspec
import numpy as np

from footsense.clock import stopwatch_ns
from footsense.config import DEFAULT, SMALL_BOARD, Config
from footsense.daemon.scheduling import resident_mib
from footsense.daemon.service import open_service
from footsense.frames import State
from footsense.sim.faults.scene_faults import CanTraffic
from footsense.sim.scene import Effects, Scene, Warming
from footsense.sim.scene_loads import Standstill, Tripod
from footsense.validation.invariants import InvariantChecker, Violation
from footsense.validation.random_faults import random_faults
from footsense.validation.tolerances import WalkLimits

#: Hours of a day at the full rate.
_FAST_GAIT_HOURS = 4.0
#: Stretches with a stand, and begin and end of the stand [s].
_N_STANDS, _STAND_S = 2, (1200.0, 3000.0)


class Stretch(msgspec.Struct, frozen=True, kw_only=True):
    """Part of the soak test, run by one process: seed, hours, conversion rate, standstills, temperature.

    Attributes:
        number: Index in the day.
        seed: Seed of everything random.
        hours: Duration [h].
        rate_sps: Conversions per second; at 100 the robot walks at a quarter of its pace.
        publish_every: Conversions per force on CAN.
        standstill_spans_s: Spans in which the robot stands [s].
        warming_k: Warming over ten minutes [K].
    """

    number: int = 0
    seed: int = 0
    hours: float
    rate_sps: int = 400
    publish_every: int = 4
    standstill_spans_s: tuple[tuple[float, float], ...] = ()
    warming_k: float = 0.0

    @property
    def gait_period_s(self) -> float:
        """Gait period [s], proportional to the conversion period."""
        return 1.2 * 400 / self.rate_sps


def soak_stretches(hours: float, seed: int) -> list[Stretch]:
    """Return the stretches of a soak test, each with its own rates, seed and standstills.

    A day has four hours at 400 S/s, one of them with a force on CAN for each conversion, two of them with warming and
    cooling, and the rest at 100 S/s, which takes a third of the computing time, with two stands. Up to four hours are
    three stretches: 400 S/s, the same with each force on CAN, and 100 S/s.
    """
    if hours <= _FAST_GAIT_HOURS:
        third = hours / 3.0
        plan = [
            Stretch(hours=third),
            Stretch(hours=third, publish_every=1),
            Stretch(hours=third, rate_sps=100),
        ]
    else:
        plan = [Stretch(hours=1.0, publish_every=1)]
        plan += [Stretch(hours=1.0, warming_k=kelvin) for kelvin in (0.0, 20.0, -20.0)]
        for number, begun in enumerate(np.arange(_FAST_GAIT_HOURS, hours, 2.0).tolist()):
            length = min(2.0, hours - begun)
            stands = number < _N_STANDS and length * 3600.0 > _STAND_S[1] + 600.0
            plan.append(Stretch(hours=length, rate_sps=100, standstill_spans_s=(_STAND_S,) if stands else ()))
    return [
        msgspec.structs.replace(stretch, number=number, seed=1000 * seed + number)
        for number, stretch in enumerate(plan)
    ]


#: Time at the begin in which all feet are in the air [s].
LEAD_IN_S = 1.0
#: Rare frames of another node, with the lowest priority: CAN is simulated only with traffic or faults on it.
IDLE_TRAFFIC = CanTraffic(at_s=0.0, can_id=0x7FF, rate_hz=0.1)


def robot_and_fault_free_scene(stretch: Stretch, *, warming_time_scale: float = 1.0) -> tuple[Config, Scene]:
    """Return the robot configuration and the fault-free scene of a stretch.

    Args:
        stretch: The stretch.
        warming_time_scale: Factor on start and duration of the warming, each 10 min. A warmer foot reads too small a
            force, which no sigma covers: a shorter walk of comparison needs the whole warming.
    """
    # Seeds of stretches are thousands of the soak test's.
    robot = (DEFAULT, SMALL_BOARD)[stretch.seed // 1000 % 2]
    bitrate = 1_000_000 if stretch.publish_every == 1 else robot.can.bitrate
    config = msgspec.structs.replace(
        robot,
        scan=msgspec.structs.replace(robot.scan, rate_sps=stretch.rate_sps),
        publish_every=stretch.publish_every,
        can=msgspec.structs.replace(robot.can, bitrate=bitrate),
    )
    warming_s = 600.0 * warming_time_scale
    scene = Scene(
        description="A robot walks for hours, with faults.",
        load=Tripod(
            period_s=stretch.gait_period_s,
            duty_rel=0.6,
            peak_force_n=0.9,
            friction_rel=0.15,
            pitch_deg=10.0,
            stands=tuple(
                Standstill(from_s=from_s, until_s=until_s) for from_s, until_s in stretch.standstill_spans_s
            ),
        ),
        lead_in_s=LEAD_IN_S,
        seed=stretch.seed,
        gait_table=True,
        effects=Effects(
            converter_noise=True,
            converter_clock_rel=0.01,
            gap_contact=True,
            warming=Warming(from_s=warming_s, over_s=warming_s, kelvin=stretch.warming_k)
            if stretch.warming_k
            else None,
        ),
        faults=(IDLE_TRAFFIC,),
    )
    return config, scene


_NS_PER_S = 1_000_000_000
#: Length of the walk without faults [gait periods], and its largest share of that with faults [1].
_N_FAULT_FREE_GAIT_PERIODS, _MAX_FAULT_FREE_REL = 200, 0.25
#: Longest gap between two frames of a healthy robot [conversions].
_MAX_HEALTHY_GAP_CONVERSIONS = 1.5
#: Time of the first look at the memory [s]: everything has been used once by then.
_FIRST_MEMORY_CHECK_AFTER_S = 120.0
#: Standard deviations of a count that are chance.
_MAX_CHANCE_EXCESS_SIGMAS = 5.0
#: Frames that count as one: an error lasts for a few frames, and recurs in every step.
_N_CORRELATED_FRAMES = 20
#: Growth of memory within the variation of the allocator, over an hour at least [MiB/h].
_MAX_GROWTH_MIB_PER_H = 2.0
#: Time without faults at the end [s]: more than the recovery from several that overlap.
_FAULT_FREE_TAIL_S = 20.0
_RARE_ERRORS_RULE, _MEMORY_RULE = "no error beyond 5 sigma more often than calibrated", "memory does not grow"
#: Period of the cycles over that of the conversions without their transactions [1].
_CONVERSION_REL = 1.08
_GAP_RULE = "a healthy robot's frames have no gap"


class StretchResult(msgspec.Struct, frozen=True, kw_only=True):
    """Result of one stretch of the soak test: counts, violations, error rates and memory growth.

    Attributes:
        stretch: The stretch.
        virtual_s: Virtual time [s].
        wall_s: Computing time [s].
        n_injected_faults: Faults in it.
        n_cycles: Cycles of the loop, one for each conversion.
        n_leg_cycles_by_state: Cycles of the legs by state.
        n_violations: Violations by invariant.
        first_violations: The first violations.
        longest_cycle_interval_s: Longest time between two cycles [s].
        beyond_5_sigma_share: Share of the usable forces with an error beyond 5 sigma, by axis [1].
        fault_free_beyond_5_sigma_share: The same of the walk without faults.
        n_received_force_frames: Frames of `Force` that arrived on CAN.
        n_missed_force_frames: Frames of `Force` that were lost while CAN was broken.
        warm_and_end_resident_mib: Memory after the first minutes, and at the end [MiB].
        growth_mib_per_h: Growth per virtual hour [MiB/h].
    """

    stretch: Stretch
    virtual_s: float
    wall_s: float
    n_injected_faults: int
    n_cycles: int
    n_leg_cycles_by_state: dict[str, int]
    n_violations: dict[str, int]
    first_violations: list[Violation]
    longest_cycle_interval_s: float
    beyond_5_sigma_share: tuple[float, ...]
    fault_free_beyond_5_sigma_share: tuple[float, ...]
    n_received_force_frames: int
    n_missed_force_frames: int
    warm_and_end_resident_mib: tuple[float, float]
    growth_mib_per_h: float

    @property
    def line(self) -> str:
        """The result as a line of text."""
        stretch = self.stretch
        every = ["every force on CAN"] if stretch.publish_every == 1 else []
        warmer = [f"{stretch.warming_k:+g} K"] if stretch.warming_k else []
        stand = ["with a stand"] if stretch.standstill_spans_s else []
        warm_mib, end_mib = self.warm_and_end_resident_mib
        return (
            f"stretch {stretch.number}: {stretch.hours:g} h "
            f"{', '.join([f'{stretch.rate_sps} S/s', *every, *warmer, *stand])}: {self.n_injected_faults} faults, "
            f"{sum(self.n_violations.values())} violations, "
            f"longest gap {1e3 * self.longest_cycle_interval_s:.0f} ms, {warm_mib:.1f} to {end_mib:.1f} MiB "
            f"({self.growth_mib_per_h:+.2f} MiB/h), {self.virtual_s / self.wall_s:.1f} x real time"
        )


def walk_stretch(stretch: Stretch) -> StretchResult:
    """Simulate one stretch of the soak test, with and without its faults; return counts, violations and errors.

    Raises:
        ModelError: The released network or the response table is missing.
    """
    ends_s = 3600.0 * stretch.hours
    calm_s = min(LEAD_IN_S + _N_FAULT_FREE_GAIT_PERIODS * stretch.gait_period_s, _MAX_FAULT_FREE_REL * ends_s)
    config, calm_scene = robot_and_fault_free_scene(stretch, warming_time_scale=calm_s / ends_s)
    rules = WalkLimits(
        legs=config.legs,
        cycle_period_s=_CONVERSION_REL / stretch.rate_sps,
        max_age_s=config.effective_max_age_ms * 1e-3,
        gait_period_s=stretch.gait_period_s,
        checks_start_s=LEAD_IN_S + 1.0,
        cycles_per_can_force=config.effective_publish_every,
        bit_s=config.can.bit_ns * 1e-9,
    )
    fault_free, _ = _simulate_stretch(config, calm_scene, rules, calm_s)
    begins_s = min(_FIRST_MEMORY_CHECK_AFTER_S, 0.1 * ends_s)
    # The last fault ends in time for all legs to recover.
    last_s = ends_s - _FAULT_FREE_TAIL_S - 3.0 * stretch.gait_period_s
    script = random_faults(np.random.default_rng(stretch.seed), config.legs, begins_s, last_s, config.board)
    period_s = calm_s / fault_free.n_cycles
    rules = rules._replace(cycle_period_s=period_s, standstill_spans_s=stretch.standstill_spans_s)
    config, scene = robot_and_fault_free_scene(stretch)
    began_ns = stopwatch_ns()
    with_faults, (warm_mib, end_mib) = _simulate_stretch(
        config, msgspec.structs.replace(scene, faults=(IDLE_TRAFFIC, *script)), rules, ends_s
    )
    wall_s = (stopwatch_ns() - began_ns) / _NS_PER_S
    growth_mib_per_h = (end_mib - warm_mib) / (max(ends_s - _FIRST_MEMORY_CHECK_AFTER_S, 1.0) / 3600.0)
    violations = fault_free.violations + _too_frequent_errors(fault_free, with_faults, ends_s)
    if fault_free.longest_gap_s > _MAX_HEALTHY_GAP_CONVERSIONS * period_s:
        violations.append(Violation(_GAP_RULE, calm_s, "", f"{1e3 * fault_free.longest_gap_s:.1f} ms"))
    if stretch.hours >= 1.0 and growth_mib_per_h > _MAX_GROWTH_MIB_PER_H:
        violations.append(Violation(_MEMORY_RULE, ends_s, "", f"{warm_mib:.1f} to {end_mib:.1f} MiB"))
    return StretchResult(
        stretch=stretch,
        virtual_s=ends_s,
        wall_s=wall_s,
        n_injected_faults=len(script),
        n_cycles=with_faults.n_cycles,
        n_leg_cycles_by_state={
            State(state).name.lower(): n for state, n in sorted(with_faults.n_states.items())
        },
        n_violations=dict(
            with_faults.n_violations + Counter(violation.invariant for violation in violations)
        ),
        first_violations=with_faults.violations + violations,
        longest_cycle_interval_s=with_faults.longest_gap_s,
        beyond_5_sigma_share=tuple((with_faults.n_beyond / with_faults.n_checked).tolist()),
        fault_free_beyond_5_sigma_share=tuple((fault_free.n_beyond / fault_free.n_checked).tolist()),
        n_received_force_frames=with_faults.n_received,
        n_missed_force_frames=with_faults.n_missed,
        warm_and_end_resident_mib=(warm_mib, end_mib),
        growth_mib_per_h=growth_mib_per_h,
    )


def _too_frequent_errors(
    fault_free: InvariantChecker, with_faults: InvariantChecker, ends_s: float
) -> list[Violation]:
    """Return a violation for each force axis with significantly more errors beyond 5 sigma than without faults."""
    # Both shares are counts; the shorter walk may have met no rare error.
    both_rel = (fault_free.n_beyond + with_faults.n_beyond) / (fault_free.n_checked + with_faults.n_checked)
    chance_rel = _MAX_CHANCE_EXCESS_SIGMAS * np.sqrt(
        _N_CORRELATED_FRAMES * both_rel * (1.0 / fault_free.n_checked + 1.0 / with_faults.n_checked)
    )
    allowed = with_faults.n_checked * (fault_free.n_beyond / fault_free.n_checked + chance_rel)
    return [
        Violation(
            _RARE_ERRORS_RULE,
            ends_s,
            "",
            f"f{'xyz'[axis]}: {with_faults.n_beyond[axis]} of {with_faults.n_checked}, at most {allowed[axis]:.0f}",
        )
        for axis in np.flatnonzero(with_faults.n_beyond > allowed).tolist()
    ]


def _simulate_stretch(
    config: Config, scene: Scene, rules: WalkLimits, until_s: float
) -> tuple[InvariantChecker, tuple[float, float]]:
    """Simulate a walk up to a time [s]; return the checks, and the memory early and at the end [MiB]."""
    with open_service(config, scene, real_time=False) as running:
        assert running.true_force_n_at is not None, "a scene is simulated"
        assert running.simulated_can is not None, "the scene has traffic on CAN"
        checks = InvariantChecker(rules, scene.faults, running.true_force_n_at)
        running.observers.append(checks)
        running.simulated_can.controller.on_delivered = checks.on_delivered
        running.run(until_ns=min(_FIRST_MEMORY_CHECK_AFTER_S, until_s) * _NS_PER_S)
        warm_mib = resident_mib()
        running.run(until_ns=until_s * _NS_PER_S)
        return checks, (warm_mib, resident_mib())
