"""Walks through the whole service, simulated chips included: forces of larger robots, and with couplings."""

from typing import Any, NamedTuple

from msgspec.structs import replace

from firmware_interface.chips import ad7147, fdc1004
from footsense.config import Config
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.type_folders import foot_type_folder
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE
from footsense.lab.evaluation.walker_runs import HOST_COST_US
from footsense.lab.foot_file import FOOT_FILE, load_foot
from footsense.lab.parallel import compute_each
from footsense.lab.report import StudyContext, Values
from footsense.lab.studies.boards.force_figures import force_figures
from footsense.lab.studies.boards.robots import robot_of
from footsense.sim.chips.beside import unloaded_stray_pf
from footsense.sim.couplings import COUPLINGS_FILE, Couplings, load_couplings
from footsense.sim.scene import Ad7147Effects, Scene
from footsense.telemetry.run_statistics import LOADED_THRESHOLD_REL
from footsense.validation.fault_trial import simulate_scene

#: End of the walks, of the larger robots and with couplings [s].
END_S, _QUICK_END_S, _QUICK_COUPLED_END_S = 6.0, 3.2, 2.2
#: The larger feet, and the scenes of their robots.
OWN_FEET, _OWN_SCENES = ("hexapod-2kg", "quadruped-12kg"), ("hexapod_2kg", "quadruped_12kg")
#: Most that the clocks of the converters are off by in the walks with couplings, as the data sheets allow [1]. Other
#: times of the host [us].
_CLOCKS_REL = {"ad7147": ad7147.CLOCK_TOLERANCE_REL, "fdc1004": fdc1004.CLOCK_TOLERANCE_REL}
_SLOW_HOST_US = 150
#: Walk and tripod of the paper's foot whose strays are known, on the usual host.
KNOWN_STRAYS = f"measured walk, strays known, {HOST_COST_US} us"
TRIPOD = f"tripod, strays known, {HOST_COST_US} us"
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
        `own_robots`, those of `force_figures` by robot; `couplings`, the same of walks with couplings, by what is known
        of them, and the host's time of a transaction.
    """
    robot = robot_of(context, board)
    files = (FOOT_FILE, RESPONSE_FILE, NETWORK_FILE)
    end_s, coupled_end_s = (_QUICK_END_S, _QUICK_COUPLED_END_S) if context.quick else (END_S, END_S)
    studied = replace(robot, foot_type=str(context.files(*files).resolve()))
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
            _scene(context, _OWN_SCENES[0]), replace(robot, foot_type=OWN_FEET[0]), end_s
        ),
        f"quadruped of 12 kg, trot at {_TROT_PERIOD_S:g} s": ServiceWalk(
            replace(trot, load=replace(trot.load, period_s=_TROT_PERIOD_S)),
            replace(robot, buses=of_four, foot_type=OWN_FEET[1]),
            end_s,
        ),
    }
    coupled = _coupled_walks(context, studied, coupled_end_s)
    forces = compute_each(_forces, [*own.values(), *coupled.values()])
    return {
        "own_robots": dict(zip(own, forces, strict=False)),
        "couplings": dict(zip(coupled, forces[len(own) :], strict=True)),
    }


def _scene(context: StudyContext, name: str) -> Scene:
    return replace(context.scene(name), host_cost_us=HOST_COST_US)


def _coupled_walks(context: StudyContext, robot: Config, end_s: float) -> dict[str, ServiceWalk]:
    """Return walks with couplings, on feet of which nobody knows, and with known strays: on a slow host and rubber too.

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
        KNOWN_STRAYS: ServiceWalk(coupled, known, end_s),
        TRIPOD: ServiceWalk(replace(coupled, load=context.scene("tripod").load), known, end_s),
        f"measured walk, strays known, {_SLOW_HOST_US} us": ServiceWalk(
            replace(coupled, host_cost_us=_SLOW_HOST_US), known, end_s
        ),
        "measured walk, strays known, rubber creeps and lags": ServiceWalk(
            replace(coupled, effects=replace(effects, rubber=True)), known, end_s
        ),
    }


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
