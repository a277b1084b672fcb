"""A simulated foot that becomes softer than the others."""

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from footsense.config import DEFAULT
from footsense.daemon.acquisition import open_scan_source
from footsense.sim.scene import Scene, Softening
from footsense.sim.scene_files import load_scene
from footsense.sim.scene_loads import Tripod
from tests.support.feet import DESIGN

SOFTENS = Softening(leg="rm", from_s=0.5, over_s=1.0, softer_rel=0.04)
ROBOT = msgspec.structs.replace(
    DEFAULT, buses=(msgspec.structs.replace(DEFAULT.buses[0], legs={"lf": 0, "rm": 4}),)
)
LF, RM = 0, 1


def closures_um(scene: Scene) -> NDArray[np.float64]:
    """Return the closures of every scan of two seconds [um], shape (scans, legs, 9)."""
    scans = []
    with open_scan_source(ROBOT, scene) as started:
        while started.clock.now_ns() < 2e9:
            scans.append(started.read_whole_scans(1)[0].capacitance_pf)
    return DESIGN.plate_distance_um(np.array([DESIGN.unloaded_pf])) - DESIGN.plate_distance_um(
        np.array(scans)
    )


@pytest.mark.parametrize("gait_table", [False, True])
def test_its_closures_grow_and_those_of_the_others_stay(*, gait_table: bool) -> None:
    """By 4 % in the end, however the foot is computed."""
    scene = msgspec.structs.replace(
        load_scene("hanging"),
        load=Tripod(period_s=1.0, duty_rel=0.6, peak_force_n=0.3),
        lead_in_s=0.0,
        gait_table=gait_table,
    )
    effects = msgspec.structs.replace(scene.effects, converter_noise=False)
    before = closures_um(msgspec.structs.replace(scene, effects=effects))
    softened = msgspec.structs.replace(effects, softening=SOFTENS)
    after = closures_um(msgspec.structs.replace(scene, effects=softened))
    assert np.allclose(after[:, LF], before[:, LF], atol=2e-3)
    pressed = before[-40:, RM] > 1.0
    grown = after[-40:, RM][pressed] / before[-40:, RM][pressed]
    assert pressed.sum() > 40
    assert 1.0 < grown.min() < grown.max() < 1.043
    assert grown[-20:] == pytest.approx(1.04, abs=2e-3)
