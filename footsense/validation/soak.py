"""A day of walking in which something breaks every half minute: stretches of it, each a process of its own.

Everything is in virtual time and follows from the seed; a stretch in which an invariant was lost is walked again by
itself. Every stretch begins with a walk in which nothing breaks, which tells how often an error is beyond 5 sigma.
"""

import logging
import math
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context

import msgspec
import numpy as np

from footsense.clock import resident_mib, stopwatch_ns
from footsense.config import DEFAULT, Config
from footsense.daemon.service import open_service
from footsense.frames import State
from footsense.sim.faults.scene_faults import CanTraffic
from footsense.sim.scene import Effects, Scene, Stand, Tripod, Warming
from footsense.validation.invariants import Invariants, Lost
from footsense.validation.random_faults import random_faults
from footsense.validation.soak_stretches import Stretch
from footsense.validation.tolerances import Rules

_NS_PER_S = 1_000_000_000
#: All feet are in the air for so long at first [s].
_LEAD_IN_S = 1.0
#: The walk without faults that others are compared with [s]: as many steps at each rate.
_CALIBRATION_STEPS = 200
#: When memory is looked at first [s]: by then everything has been used once.
_WARM_S = 120.0
#: Standard deviations of a count that are chance.
_CHANCE = 5.0
#: An error lasts for a few frames, and comes again at every step: frames that count as one.
_FRAMES_AS_ONE = 20
#: Growth of memory that is no more than the allocator's own unrest, over an hour at least [MiB/h].
_MOST_GROWTH_MIB_PER_H = 2.0
#: Nothing breaks any more for so long at the end [s].
_QUIET_END_S = 60.0
#: Another node that now and then says something behind all of ours: CAN is simulated where something is on it.
_QUIET = CanTraffic(at_s=0.0, can_id=0x7FF, rate_hz=0.1)
_RARE, _GROWS = "no error beyond 5 sigma more often than calibrated", "memory does not grow"


class Walked(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a stretch.

    Attributes:
        stretch: Which.
        virtual_s: How long it was [s].
        wall_s: What it took [s].
        n_faults: What broke.
        n_cycles: Frames that were published.
        n_states: Leg frames by state.
        n_lost: Invariants that did not hold, by name.
        lost: The first of them.
        worst_gap_s: Longest time between two frames [s].
        beyond_rel: Share of the usable forces with an error beyond 5 sigma, by axis [1].
        calibrated_rel: The same of the walk in which nothing broke.
        n_heard: Frames of `Force` that arrived on CAN.
        n_missed: Those that CAN lost while it was broken.
        resident_mib: Memory when all had been used once, and at the end [MiB].
        growth_mib_per_h: What was added per virtual hour [MiB/h].
    """

    stretch: Stretch
    virtual_s: float
    wall_s: float
    n_faults: int
    n_cycles: int
    n_states: dict[str, int]
    n_lost: dict[str, int]
    lost: list[Lost]
    worst_gap_s: float
    beyond_rel: tuple[float, ...]
    calibrated_rel: tuple[float, ...]
    n_heard: int
    n_missed: int
    resident_mib: tuple[float, float]
    growth_mib_per_h: float


def _quiet() -> None:
    """Say nothing of what breaks: that is on purpose."""
    logging.disable(logging.WARNING)


def walk_day(stretches: list[Stretch], jobs: int) -> Iterator[Walked]:
    """Walk stretches in processes of their own.

    Args:
        stretches: What is to be walked.
        jobs: How many at a time.

    Yields:
        Each stretch as it ends.
    """
    with ProcessPoolExecutor(
        jobs, mp_context=get_context("spawn"), initializer=_quiet, max_tasks_per_child=1
    ) as processes:
        running = [processes.submit(walk_stretch, stretch) for stretch in stretches]
        for walked in as_completed(running):
            yield walked.result()


def walk_stretch(stretch: Stretch) -> Walked:
    """Walk one stretch.

    Raises:
        ModelError: The released network or the response table is missing.
    """
    config, scene, gait_period_s = _walk(stretch)
    rules = Rules(
        legs=config.legs,
        period_s=math.inf,
        max_age_s=config.stale_after_ms * 1e-3,
        gait_period_s=gait_period_s,
        from_s=_LEAD_IN_S + 1.0,
        element=stretch.publish == "element",
        bitrate=config.can.bitrate,
    )
    ends_s = 3600.0 * stretch.hours
    calm_s = _LEAD_IN_S + _CALIBRATION_STEPS * gait_period_s
    whole = _Course(config, _calm(scene, calm_s / ends_s), rules)
    whole.walk(calm_s)
    rng = np.random.default_rng(stretch.seed)
    # All that breaks has been mended and is well again at the end.
    begins_s = min(_WARM_S, 0.1 * ends_s)
    script = random_faults(rng, config.legs, begins_s, ends_s - _QUIET_END_S - 3.0 * gait_period_s)
    rules = rules._replace(period_s=whole.period_s, stands_s=stretch.stands_s)
    course = _Course(config, msgspec.structs.replace(scene, faults=(_QUIET, *script)), rules)
    began_ns = stopwatch_ns()
    course.walk(ends_s)
    wall_s = (stopwatch_ns() - began_ns) / _NS_PER_S
    seen = course.seen
    lost = Counter(seen.n_lost)
    calibrated_rel = whole.seen.n_beyond / whole.seen.n_checked
    # Both shares are counted, and the shorter walk's is the less certain: of rare errors it may have met none.
    both_rel = (whole.seen.n_beyond + seen.n_beyond) / (whole.seen.n_checked + seen.n_checked)
    chance_rel = _CHANCE * np.sqrt(
        _FRAMES_AS_ONE * both_rel * (1.0 / whole.seen.n_checked + 1.0 / seen.n_checked)
    )
    allowed = seen.n_checked * (calibrated_rel + chance_rel)
    for axis in np.flatnonzero(seen.n_beyond > allowed).tolist():
        lost[_RARE] += 1
        what = f"f{'xyz'[axis]}: {seen.n_beyond[axis]} of {seen.n_checked}, at most {allowed[axis]:.0f}"
        seen.lost.append(Lost(_RARE, ends_s, "", what))
    warm_mib, end_mib = course.resident_mib
    growth_mib_per_h = (end_mib - warm_mib) / (max(ends_s - _WARM_S, 1.0) / 3600.0)
    if stretch.hours >= 1.0 and growth_mib_per_h > _MOST_GROWTH_MIB_PER_H:
        lost[_GROWS] += 1
        seen.lost.append(Lost(_GROWS, ends_s, "", f"{warm_mib:.1f} to {end_mib:.1f} MiB"))
    return Walked(
        stretch=stretch,
        virtual_s=ends_s,
        wall_s=wall_s,
        n_faults=len(script),
        n_cycles=seen.n_cycles,
        n_states={State(state).name.lower(): n for state, n in sorted(seen.n_states.items())},
        n_lost=dict(lost),
        lost=seen.lost,
        worst_gap_s=seen.worst_gap_s,
        beyond_rel=tuple((seen.n_beyond / seen.n_checked).tolist()),
        calibrated_rel=tuple(calibrated_rel.tolist()),
        n_heard=seen.n_heard,
        n_missed=seen.n_missed,
        resident_mib=(warm_mib, end_mib),
        growth_mib_per_h=growth_mib_per_h,
    )


class _Course:
    """One walk of the whole service, watched."""

    def __init__(self, config: Config, scene: Scene, rules: Rules) -> None:
        self._config, self._scene, self._rules = config, scene, rules
        self.resident_mib = (0.0, 0.0)
        self.period_s = math.nan

    def walk(self, until_s: float) -> None:
        """Walk up to a time [s], and look at the memory when all has been used once, and at the end."""
        with open_service(self._config, self._scene, real_time=False) as running:
            scan_source = running.scan_source
            assert scan_source.true_force_n is not None, "a scene is simulated"
            assert running.can is not None, "the script has something on CAN"
            self.seen = Invariants(self._rules, self._scene.faults, scan_source.true_force_n)
            running.observers.append(self.seen)
            running.can.controller.hear = self.seen.hear
            clock = scan_source.clock
            running.run(lambda: clock.now_ns() >= min(_WARM_S, until_s) * _NS_PER_S)
            warm_mib = resident_mib()
            running.run(lambda: clock.now_ns() >= until_s * _NS_PER_S)
            self.resident_mib = (warm_mib, resident_mib())
        self.period_s = until_s / self.seen.n_cycles


def _calm(scene: Scene, share: float) -> Scene:
    """Return the same walk with nothing breaking, for a share of its time: it gets warm as much sooner.

    A foot that is warmer reads less than it feels, which no sigma knows: what others are compared with has to have it.
    """
    warming = scene.effects.warming
    if warming is not None:
        warming = msgspec.structs.replace(
            warming, from_s=share * warming.from_s, over_s=share * warming.over_s
        )
    effects = msgspec.structs.replace(scene.effects, warming=warming)
    return msgspec.structs.replace(scene, faults=(_QUIET,), effects=effects)


def _walk(stretch: Stretch) -> tuple[Config, Scene, float]:
    """Return the robot of a stretch, its scene without faults, and the period of its gait [s]."""
    bitrate = 1_000_000 if stretch.publish == "element" else DEFAULT.can.bitrate
    config = msgspec.convert(
        {
            **msgspec.to_builtins(DEFAULT),
            "scan": {"rate_sps": stretch.rate_sps},
            "publish": stretch.publish,
            "can": {**msgspec.to_builtins(DEFAULT.can), "bitrate": bitrate},
        },
        type=Config,
    )
    gait_period_s = 1.2 * 400 / stretch.rate_sps
    warming = Warming(from_s=600.0, over_s=600.0, kelvin=stretch.kelvin) if stretch.kelvin else None
    scene = Scene(
        description="A robot walks for hours, and things break.",
        load=Tripod(
            period_s=gait_period_s,
            duty_rel=0.6,
            peak_force_n=0.9,
            friction_rel=0.15,
            pitch_deg=10.0,
            stands=tuple(Stand(from_s=from_s, until_s=until_s) for from_s, until_s in stretch.stands_s),
        ),
        lead_in_s=_LEAD_IN_S,
        seed=stretch.seed,
        gait_table=True,
        effects=Effects(converter_noise=True, converter_clock_rel=0.01, gap_contact=True, warming=warming),
    )
    return config, scene, gait_period_s
