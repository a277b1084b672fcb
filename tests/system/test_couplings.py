"""Couplings through the whole service: what they do to a walk, and what their builder has to know."""

from pathlib import Path
from shutil import copytree

import pytest
from msgspec.structs import replace

from footsense.config import SMALL_BOARD, Config
from footsense.daemon.foot_types import released_path
from footsense.daemon.simulation import simulated_robot
from footsense.errors import ModelError
from footsense.frames import IS_USABLE_STATE
from footsense.sim.chips.beside import unloaded_stray_pf
from footsense.sim.couplings import COUPLINGS_FILE, Couplings, load_couplings
from footsense.sim.faults.scene_faults import MetalBesideTail
from footsense.sim.scene import Scene, load_scene
from footsense.validation.fault_trial import PublishedWalk, simulate_scene

_UNLOADED_PF = 5.387


def coupled(**settings: float) -> Scene:
    """Return the measured walk with couplings."""
    scene = load_scene("measured_walk")
    return replace(scene, effects=replace(scene.effects, couplings=Couplings(**settings)))  # type: ignore[arg-type]


def with_known_strays(config: Config) -> Config:
    """Return a robot whose configuration has what its elements read beside their own capacitance."""
    of_board = load_couplings(released_path(COUPLINGS_FILE)).boards[config.board]
    stray_pf = unloaded_stray_pf(config.board, of_board, Couplings(), _UNLOADED_PF)
    return replace(config, stray_pf=dict.fromkeys(config.legs, tuple(stray_pf)))


def usable_share(walk: PublishedWalk) -> float:
    return float(IS_USABLE_STATE[walk.state][walk.t_sent_ns > 2e9].mean())


@pytest.mark.slow
def test_one_converter_walks_if_its_strays_are_known() -> None:
    """Board `fdc1004`: the tare refuses feet that read a picofarad more than the design's, until `stray_pf` says it."""
    assert usable_share(simulate_scene(coupled(), SMALL_BOARD, 3.0)) == 0.0
    assert usable_share(simulate_scene(coupled(), with_known_strays(SMALL_BOARD), 3.0)) == 1.0


@pytest.mark.parametrize(
    "scene", [coupled(), replace(load_scene("tripod"), faults=(MetalBesideTail(at_s=1),))]
)
def test_a_foot_without_a_table_is_refused_where_a_scene_asks_for_it(scene: Scene, tmp_path: Path) -> None:
    folder = tmp_path / "aoyagi-3x3"
    copytree(released_path(COUPLINGS_FILE).parent, folder)
    (folder / COUPLINGS_FILE).unlink()
    robot = replace(SMALL_BOARD, foot_type=str(folder))
    with pytest.raises(ModelError, match="`footsense lab couplings` writes it"):
        simulated_robot(robot, scene)
    simulated_robot(robot, load_scene("hanging"))
