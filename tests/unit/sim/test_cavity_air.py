"""Simulated feet whose cavities hold their air."""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from footsense.config import DEFAULT
from footsense.daemon.acquisition import open_scan_source
from footsense.daemon.foot_types import released_path
from footsense.errors import ConfigError
from footsense.foot.cavity import AMBIENT_KPA, Cavity
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.sim.foot.cavity_air import CavityAir
from footsense.sim.scene import Cavities
from footsense.sim.scene_files import load_scene
from footsense.sim.scene_loads import Constant
from tests.support.feet import DESIGN

RESPONSE = FootResponse.load(released_path("response.npz"))

ROBOT = msgspec.structs.replace(DEFAULT, buses=(msgspec.structs.replace(DEFAULT.buses[0], legs={"lf": 0}),))
UP, FORCE_N = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 0.5])
SECOND_NS = 1_000_000_000


def closures_um(cavity: Cavities | None, seconds: float = 2.0) -> Vector:
    """Return the mean closure of a foot under half a newton from 0.5 s on, scan by scan [um]."""
    hanging = load_scene("hanging")
    effects = msgspec.structs.replace(hanging.effects, converter_noise=False, cavity=cavity)
    load = Constant(force_n=(0.0, 0.0, 0.5))
    scene = msgspec.structs.replace(hanging, effects=effects, load=load, lead_in_s=0.5)
    scans = []
    with open_scan_source(ROBOT, scene) as started:
        while started.clock.now_ns() < seconds * 1e9:
            scans.append(started.read_whole_scans(1)[0].capacitance_pf[0])
    unloaded_um = DESIGN.plate_distance_um(np.array([DESIGN.unloaded_pf]))
    return np.asarray((unloaded_um - DESIGN.plate_distance_um(np.array(scans))).mean(axis=1))


def test_a_scene_names_the_cavities_of_its_feet() -> None:
    """Sealed feet close by a ninth; leaking ones begin there and go towards vented ones while the load stays."""
    vented, sealed = closures_um(None), closures_um(Cavities(kind="sealed"))
    leaking = closures_um(Cavities(kind="leaking", leak_time_s=0.1))
    assert 6.0 < vented[-1] / sealed[-1] < 11.0
    pressed = np.flatnonzero(vented > 0.99 * vented[-1])[0]
    assert leaking[pressed] == pytest.approx(sealed[-1], rel=0.4)
    assert (np.diff(leaking[pressed:]) > 0.0).all()
    assert 0.6 * vented[-1] < leaking[-1] < vented[-1]


def test_warmth_and_weather_move_sealed_feet_alone() -> None:
    """Thinner air outside and warmer air inside press the plates apart; a leaking foot has long followed outside."""
    sealed, leaking = (
        Foot(replace(RESPONSE, cavity=cavity))
        for cavity in (Cavity(kind="sealed"), Cavity(kind="leaking", leak_time_s=9.0))
    )
    high_pf = CavityAir(sealed, AMBIENT_KPA - 1.2).next_capacitance_pf(0, UP, 0.0 * UP)
    warm_pf = CavityAir(sealed).next_capacitance_pf(0, UP, 0.0 * UP, kelvin=5.0)
    assert (high_pf < sealed.unloaded_pf - 0.01).all()
    assert (warm_pf < sealed.unloaded_pf - 0.01).all()
    np.testing.assert_allclose(
        CavityAir(leaking, AMBIENT_KPA - 1.2).next_capacitance_pf(0, UP, 0.0 * UP),
        leaking.unloaded_pf,
        rtol=1e-12,
    )


def test_air_that_leaked_out_is_missing_after_lift_off() -> None:
    """A leaking foot stays drawn together when the load is gone, and recovers."""
    air = CavityAir(foot := Foot(replace(RESPONSE, cavity=Cavity(kind="leaking", leak_time_s=1.0))))
    for tenth in range(100):
        air.next_capacitance_pf(tenth * SECOND_NS // 10, UP, FORCE_N)
    lifted_pf = air.next_capacitance_pf(10 * SECOND_NS, UP, 0.0 * UP)
    assert (lifted_pf > foot.unloaded_pf + 0.1).all()
    for tenth in range(101, 1500):
        recovered_pf = air.next_capacitance_pf(tenth * SECOND_NS // 10, UP, 0.0 * UP)
    np.testing.assert_allclose(recovered_pf, foot.unloaded_pf, atol=1e-3)


def test_an_impossible_cavity_of_a_scene_is_refused(tmp_path: Path) -> None:
    """One line with the place."""
    path = tmp_path / "scene.yaml"
    path.write_text(
        "description: leaks\nload: {kind: constant, force_n: [0, 0, 1]}\neffects: {cavity: {kind: leaking}}\n"
    )
    with pytest.raises(ConfigError, match=r"leak_time_s: a leaking cavity has one above 0 s.*effects.cavity"):
        load_scene(str(path))
