"""Walks through the whole service, simulated chips included: when touchdowns are told, and forces of larger robots."""

from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from firmware_interface.chips import ad7147, fdc1004
from footsense.config import Config
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.type_folders import foot_type_folder
from footsense.frames import Flag
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE
from footsense.lab.evaluation.walker_runs import HOST_COST_US, WalkerLoads, WalkerOutputs
from footsense.lab.evaluation.walker_scores import contact_scores
from footsense.lab.foot_file import FOOT_FILE, load_foot
from footsense.lab.parallel import compute_each
from footsense.lab.report import StudyContext, Values
from footsense.lab.studies.boards.force_figures import force_figures
from footsense.lab.studies.boards.robots import robot_of
from footsense.sim.chips.beside import unloaded_stray_pf
from footsense.sim.couplings import COUPLINGS_FILE, Couplings, load_couplings
from footsense.sim.scene import Ad7147Effects, Scene
from footsense.telemetry.run_statistics import LOADED_THRESHOLD_REL
from footsense.validation.fault_trial import PublishedWalk, simulate_scene

#: Ends of the walks whose touchdowns count, and of those of the larger robots [s].
_TOUCHES_END_S, OWN_END_S, _QUICK_END_S, _QUICK_COUPLED_END_S = 20.0, 6.0, 3.2, 2.2
#: The larger feet, and the scenes of their robots.
OWN_FEET, _OWN_SCENES = ("hexapod-2kg", "quadruped-12kg"), ("hexapod_2kg", "quadruped_12kg")
#: Scenes whose touchdowns count; only their loads do, not what breaks in them.
_TOUCHING = ("measured_walk", "tripod")
#: Most that the clocks of the converters are off by in the walks with couplings, as the data sheets allow [1]. Other
#: times of the host [us].
_CLOCKS_REL = {"ad7147": ad7147.CLOCK_TOLERANCE_REL, "fdc1004": fdc1004.CLOCK_TOLERANCE_REL}
_SLOW_HOST_US = 150
#: Time in the air before those walks [s]: chips whose gain is off are found and tared in it at any time of the host.
_COUPLED_LEAD_IN_S = 0.5
#: Legs of the quadruped, and period of its trot [s].
_FOUR_LEGS, _TROT_PERIOD_S = ("lf", "lr", "rf", "rr"), 0.6


class ServiceWalk(NamedTuple):
    """One walk: scene, robot and end [s]."""

    scene: Scene
    config: Config
    end_s: float


def service_figures(context: StudyContext, board: str) -> Values:
    """Return the figures of walks through the whole service.

    Args:
        context: As of every study.
        board: Board of the robot.

    Returns:
        `touchdowns`, of the measured walk and the tripod on the studied foot, as of `touchdown_figures`, with the end
        of each, `end_s`; `own_robots`, those of `force_figures` by robot; `couplings`, the same of walks with
        couplings, by what is known of them, and the host's time of a transaction.
    """
    robot = robot_of(context, board)
    files = (FOOT_FILE, RESPONSE_FILE, NETWORK_FILE)
    touches_end_s, own_end_s = (_QUICK_END_S,) * 2 if context.quick else (_TOUCHES_END_S, OWN_END_S)
    studied = replace(robot, foot_type=str(context.files(*files).resolve()))
    touching = [
        ServiceWalk(replace(_scene(context, name), faults=()), studied, touches_end_s) for name in _TOUCHING
    ]
    for foot_type in OWN_FEET:
        context.foot(foot_type).files(*files)
    trot: Any = _scene(context, _OWN_SCENES[1])
    of_four = tuple(
        replace(bus, **{key: {leg: place for leg, place in getattr(bus, key).items() if leg in _FOUR_LEGS}})
        for bus in robot.buses
        for key in (["addresses"] if bus.addresses else ["legs"])
    )
    own = {
        "hexapod of 2 kg, walk": ServiceWalk(
            _scene(context, _OWN_SCENES[0]), replace(robot, foot_type=OWN_FEET[0]), own_end_s
        ),
        f"quadruped of 12 kg, trot at {_TROT_PERIOD_S:g} s": ServiceWalk(
            replace(trot, load=replace(trot.load, period_s=_TROT_PERIOD_S)),
            replace(robot, buses=of_four, foot_type=OWN_FEET[1]),
            own_end_s,
        ),
    }
    coupled = _coupled_walks(context, studied, _QUICK_COUPLED_END_S if context.quick else OWN_END_S)
    contacts = compute_each(_contacts, touching, scheduler=context.scheduler)
    forces = compute_each(_forces, [*own.values(), *coupled.values()], scheduler=context.scheduler)
    return {
        "couplings": dict(zip(coupled, forces[len(own) :], strict=True)),
        "touchdowns": touchdown_figures(contacts) | {"end_s": touches_end_s},
        "own_robots": dict(zip(own, forces, strict=False)),
    }


def _scene(context: StudyContext, name: str) -> Scene:
    return replace(context.scene(name), host_cost_us=HOST_COST_US)


def _coupled_walks(context: StudyContext, robot: Config, end_s: float) -> dict[str, ServiceWalk]:
    """Return walks with couplings, on feet of which nobody knows, and with known strays; those on a slow host too.

    Chips are as their data sheets allow them to be.
    """
    walk, couplings = _scene(context, "measured_walk"), Couplings()
    effects = replace(
        walk.effects,
        ad7147=Ad7147Effects(gain_rel=ad7147.GAIN_TOLERANCE_REL, offset_rel=ad7147.GAIN_TOLERANCE_REL),
        converter_clock_rel=_CLOCKS_REL[robot.board],
        couplings=couplings,
    )
    coupled = replace(walk, lead_in_s=_COUPLED_LEAD_IN_S, effects=effects)
    table = load_couplings(context.files(COUPLINGS_FILE) / COUPLINGS_FILE)
    stray_pf = unloaded_stray_pf(
        robot.board, table.boards[robot.board], couplings, context.response.design.unloaded_pf
    )
    known = replace(robot, stray_pf=dict.fromkeys(robot.legs, tuple(stray_pf)))
    return {
        f"measured walk, strays not known, {HOST_COST_US} us": ServiceWalk(coupled, robot, end_s),
        **{
            f"measured walk, strays known, {cost_us} us": ServiceWalk(
                replace(coupled, host_cost_us=cost_us), known, end_s
            )
            for cost_us in (HOST_COST_US, _SLOW_HOST_US)
        },
    }


def touchdown_figures(contacts: list[Values]) -> Values:
    """Return when touchdowns are told in walks, whose scores are those of `contact_scores`.

    Returns:
        `delay_p50_ms` and `delay_p99_ms`, from the first load to the sending, infinite of a touch that is
        not told; `back_dated_rms_ms`, error of the times of those that are.
    """
    n_missed = sum(one["n_missed"] for one in contacts)
    delays_ms = [delay for one in contacts for delay in one["delays_ms"]] + n_missed * [np.inf]
    errors_ms = [error for one in contacts for error in one["errors_ms"]]
    return {
        "delay_p50_ms": np.percentile(delays_ms, 50, method="nearest"),
        "delay_p99_ms": np.percentile(delays_ms, 99, method="nearest"),
        "back_dated_rms_ms": np.sqrt(np.mean(np.square(errors_ms))),
    }


def _contacts(walk: ServiceWalk) -> Values:
    """Return the figures of `contact_scores`."""
    load: Any = walk.scene.load
    published = simulate_scene(walk.scene, walk.config, walk.end_s)
    return contact_scores(_outputs(published, walk.scene), load.peak_force_n)


def _forces(walk: ServiceWalk) -> Values:
    """Return the figures of `force_figures`."""
    published = simulate_scene(walk.scene, walk.config, walk.end_s)
    max_n = load_foot(foot_type_folder(walk.config.foot_type) / FOOT_FILE).loads.max_n
    return force_figures(
        published.force_n,
        published.sigma_n,
        published.state,
        published.true_force_n,
        LOADED_THRESHOLD_REL * max_n,
    )


def _outputs(published: PublishedWalk, scene: Scene) -> WalkerOutputs:
    """Return the frames of a walk beside its loads, whose feet do not slide."""
    source = scene.load.build(round(1e9 * scene.lead_in_s))
    normal = np.array(
        [
            [source.contact(leg, t_ns).normal for leg in published.legs]
            for t_ns in published.t_sent_ns.tolist()
        ]
    )
    t_s = np.asarray(published.t_sent_ns * 1e-9, np.float64)
    loads = WalkerLoads.of_still_feet(t_s, published.true_force_n, normal)
    return WalkerOutputs(
        t_s=t_s,
        true=loads,
        all_loads=loads,
        force_n=published.force_n,
        sigma_n=published.sigma_n,
        state=published.state,
        cause=published.cause,
        contact=(published.flags & Flag.CONTACT) != 0,
        holds=np.full(published.state.shape, np.nan),
        events=published.events,
    )
