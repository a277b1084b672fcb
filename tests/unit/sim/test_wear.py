"""Feet that wear: what each kind of a scene does to the readings, and that a scene without them is as before."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from footsense.daemon.foot_types import released_path
from footsense.errors import ConfigError
from footsense.foot.response_table import FootResponse
from footsense.frames import Vector
from footsense.sim.robot import BusWiring, SimulatedRobot
from footsense.sim.scene import Scene, load_scene

MS = 1_000_000
#: A load that rises in 1 ms after the lead-in of 1 s, and stays.
LOAD = {"kind": "constant", "force_n": [0.1, 0.0, 0.6], "rise_s": 0.001}


@pytest.fixture(scope="module")
def response() -> FootResponse:
    return FootResponse.load(released_path("response.npz"))


def readings_pf(response: FootResponse, t_ms: list[int], n_feet: int = 6, **keys: Any) -> Vector:
    """Return the capacitances of each foot at some times, shape (feet, times, elements)."""
    scene = msgspec.convert({"description": "wear", "load": LOAD} | keys, Scene)
    legs = ("lf", "lm", "lr", "rf", "rm", "rr")[:n_feet]
    robot = SimulatedRobot(
        scene, response, [BusWiring(400_000, 0x70, dict(zip(legs, range(8), strict=False)))]
    )
    return np.array([[robot.legs[leg].wired.elements_pf(t * MS) for t in t_ms] for leg in legs])


def test_gains_wander_between_sessions_and_not_within(response: FootResponse) -> None:
    """By the asked rms of the closures, the unloaded reading unmoved, anew in each session, and again from its seed."""
    before, *later = (
        readings_pf(response, [500, 1500], fabrication={"gain_rel": 0.04, "session": session})
        for session in (0, 1, 2, 1)
    )
    np.testing.assert_array_equal(before, readings_pf(response, [500, 1500]))
    np.testing.assert_array_equal(later[0], later[2])
    np.testing.assert_array_equal(before[:, 0], later[0][:, 0])
    gains = [
        (1.0 / one[:, 0] - 1.0 / one[:, 1]) / (1.0 / before[:, 0] - 1.0 / before[:, 1]) - 1.0 for one in later
    ]
    assert np.std(gains[:2]) == pytest.approx(0.04, rel=0.25)
    assert abs(np.corrcoef(gains[0].ravel(), gains[1].ravel())[0, 1]) < 0.3


def crept_rel(response: FootResponse, **effects: Any) -> Vector:
    """Return by how much each change grew from 1 ms to 100 s under a load [1], shape (feet, elements)."""
    read = readings_pf(response, [1000, 1001, 101_000], effects=effects)
    return (read[:, 2] - read[:, 1]) / (read[:, 1] - read[:, 0])


@pytest.mark.parametrize("spread_rel", [0.003, 0.01, 0.03])
def test_elements_creep_differently_by_what_is_asked(response: FootResponse, spread_rel: float) -> None:
    grown = crept_rel(response, creep_spread_rel=spread_rel)
    assert grown.std() == pytest.approx(spread_rel, rel=0.25)
    assert abs(grown.mean()) < spread_rel / 3.0
    np.testing.assert_array_equal(grown, crept_rel(response, creep_spread_rel=spread_rel))


def test_rubber_creeps_more_by_each_level(response: FootResponse) -> None:
    """The foot's load grows by 7 %, 21 % and 23 %, and its readings about as much."""
    assumed, threefold, insole = (
        crept_rel(response, rubber=True, rubber_level=level).mean()
        for level in ("assumed", "threefold", "insole")
    )
    np.testing.assert_array_equal(crept_rel(response, rubber=True).mean(), assumed)
    assert threefold / assumed == pytest.approx(3.0, rel=0.25)
    assert insole / assumed == pytest.approx(3.3, rel=0.25)


def test_a_floor_adds_capacitance_to_feet_in_contact_alone(response: FootResponse) -> None:
    added = readings_pf(response, [500, 1500], effects={"floor_pf": 0.1}) - readings_pf(response, [500, 1500])
    assert not added[:, 0].any()
    assert added[:, 1].min() >= 0.07 - 1e-9
    assert added[:, 1].max() <= 0.1 + 1e-9


@pytest.mark.parametrize(
    ("effects", "problem"),
    [
        ("gait_table: true\neffects: {creep_spread_rel: 0.01}", "effects.creep_spread_rel"),
        ("effects: {rubber_level: insole}", "effects.rubber_level"),
    ],
)
def test_what_contradicts_itself_is_named(tmp_path: Path, effects: str, problem: str) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(
        f"description: wear\nload: {{kind: measured_walk, peak_force_n: 1.0}}\n{effects}\n", "utf-8"
    )
    with pytest.raises(ConfigError, match=problem):
        load_scene(str(file))
