"""`footsense test-stand calibrate --no-reference --mass-kg`: the weight of a robot tells how large forces are."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from numpy.typing import NDArray

from footsense.calibration.standing.weight import weigh_feet
from footsense.can.interface import Can
from footsense.cli.test_stand.calibration import calibrate
from footsense.config import Config
from footsense.config.sections import Bus
from footsense.daemon.foot_types import released_path
from footsense.daemon.service import open_service
from footsense.daemon.setup.expected_error import uncertainty_of_calibrated
from footsense.errors import CalibrationError
from footsense.estimation.settings import TareLimits
from footsense.foot.calibration_files import read_calibration
from footsense.foot.parameters import KNOWN_EXACTLY
from footsense.foot.response_table import FootResponse
from footsense.frames import LEGS
from footsense.sim.fabrication import draw_deviations
from footsense.sim.scene import Effects, Fabrication, Scene
from footsense.sim.scene_loads import LogLoads

Vector = NDArray[np.float64]

_MASS_KG, _GRAVITY_M_PER_S2 = 2.0, 9.80665
#: Feet from above, the legs in their order [m].
_FEET_M = np.array([[0.12, 0.12], [0.0, 0.15], [-0.12, 0.12], [0.12, -0.12], [0.0, -0.15], [-0.12, -0.12]])
#: Where the body's middle is in some postures [m].
_MIDDLES_M = np.array([[0.0, 0.0], [0.035, 0.0], [-0.035, 0.01], [0.0, 0.035], [0.0, -0.035]])
_MADE = Fabrication(seed=3, gap_um=2.0, film_um=1.0, stray_pf=0.34, stiffness_rel=0.2, mount_deg=3.0)
_ROBOT = Config(
    buses=(
        Bus(device="sim", addresses={"lf": 0x2C, "lm": 0x2D, "lr": 0x2E}),
        Bus(device="sim1", addresses={"rf": 0x2C, "rm": 0x2D, "rr": 0x2E}),
    ),
    foot_type="hexapod-2kg",
    can=Can(interface="virtual"),
    feet={
        "lf": "foot-0000",
        "lm": "foot-0001",
        "lr": "foot-0002",
        "rf": "foot-0003",
        "rm": "foot-0004",
        "rr": "foot-0005",
    },
    tare=TareLimits(unloaded_limit_rel=0.5),
)


#: The tripods, of the legs in their order.
_TRIPODS = (0, 2, 4), (1, 3, 5)
_ALL = tuple(range(6))


def _vertical_n(legs: Sequence[int], middle_m: Vector) -> Vector:
    """Return the vertical forces of a robot on some legs, equal springs, whose body's middle is there [N]."""
    stands = np.isin(_ALL, legs)
    plane = np.column_stack([np.ones(len(_FEET_M)), _FEET_M]) * stands[:, None]
    weight = _MASS_KG * _GRAVITY_M_PER_S2 * np.array([1.0, *middle_m])
    return np.asarray(plane @ np.linalg.solve(plane.T @ plane, weight))


def _postures_log(path: Path) -> float:
    """Write the loads of a robot that stands on its tripods and on all legs, and hangs; return their duration [s]."""
    rng = np.random.default_rng(4)
    t_s, force_n, normal = [0.0], [np.zeros((6, 3))], [np.tile([0.0, 0.0, 1.0], (6, 1))]

    def then(duration_s: float, force: Vector, up: Vector) -> None:
        for step_s in (0.2, duration_s):
            t_s.append(t_s[-1] + step_s)
            force_n.append(force)
            normal.append(up)

    for number in range(15):
        legs = (*_TRIPODS, _ALL)[number % 3]
        vertical_n = np.maximum(_vertical_n(legs, _MIDDLES_M[number // 3]), 0.0)
        ratio = rng.uniform(-0.12, 0.12, (6, 2))
        up = np.column_stack([rng.uniform(-0.12, 0.12, (6, 2)), np.ones(6)])
        force = vertical_n[:, None] * np.column_stack([ratio, np.ones(6)])
        then(0.9, force, up / np.linalg.norm(up, axis=1, keepdims=True))
    then(1.2, np.zeros((6, 3)), normal[0])
    np.savez(path, legs=np.array(LEGS), t_s=t_s, force_n=force_n, normal=normal)
    return t_s[-1]


def _calibrate(*arguments: str | Path) -> Result:
    return CliRunner().invoke(calibrate, ["--no-reference", *map(str, arguments)])


@pytest.mark.slow
def test_the_weight_of_a_robot_tells_the_sizes_of_its_feet(tmp_path: Path) -> None:
    """Of six feet as made they are wrong by 20 %, and then by less than 7, as sigma says; a wrong mass is named."""
    log, recording, feet = (tmp_path / name for name in ("postures.npz", "stood.mcap", "feet"))
    duration_s = _postures_log(log)
    scene = Scene(
        description="stands",
        load=LogLoads(file=str(log)),
        fabrication=_MADE,
        effects=Effects(converter_noise=True, gap_contact=True, rubber=True),
    )
    with open_service(_ROBOT, scene, record=recording, real_time=False) as service:
        service.run(until_ns=round(1e9 * (scene.lead_in_s + duration_s)))
    response = FootResponse.load(released_path("network.onnx", "hexapod-2kg").parent / "response.npz")
    true_rel = np.array(
        [draw_deviations(response, _MADE.tolerances, _MADE.seed, number).stiffness_rel for number in range(6)]
    )
    done = _calibrate(recording, "--calibrations", feet, "--mass-kg", "2", "--json")
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)
    off_rel = np.array([row["stiffness_rel"] for row in rows]) - true_rel
    sigma_rel = np.array([row["size_sigma_rel"] for row in rows])
    assert np.sqrt((true_rel**2).mean()) > 0.15
    assert np.sqrt((off_rel**2).mean()) < 0.07
    assert (np.abs(off_rel) < 2.0 * sigma_rel).all()
    assert (sigma_rel < 0.12).all()
    found = read_calibration(feet / "foot-0003")
    assert uncertainty_of_calibrated(found, KNOWN_EXACTLY).along_rel == pytest.approx(sigma_rel[3], abs=0.02)
    wrong = _calibrate(recording, "--calibrations", tmp_path / "other", "--mass-kg", "1.4")
    assert "from what was known of them" in wrong.output
    one = _calibrate(recording, "--calibrations", tmp_path / "one", "--mass-kg", "2", "--foot", "foot-0002")
    assert isinstance(one.exception, CalibrationError)
    assert "1 of the robot's 6 feet are named or wanted" in str(one.exception)


#: Of a robot that leans on each tripod [N].
_ALONG_N = np.stack([_vertical_n(legs, middle_m) for legs in _TRIPODS for middle_m in _MIDDLES_M])
_UNKNOWN_REL = np.full(6, 0.2)


@pytest.mark.parametrize("size_rel", [np.linspace(0.75, 1.25, 6), np.linspace(1.2, 0.9, 6)])
def test_leaning_on_each_tripod_tells_all_sizes(size_rel: Vector) -> None:
    found = weigh_feet(_ALONG_N / size_rel, _UNKNOWN_REL, _MASS_KG)
    np.testing.assert_allclose(found.size_rel, size_rel, atol=0.06)
    assert (found.n_postures, found.doubt) == (10, "")


def test_legs_that_are_never_told_apart_stay_unknown() -> None:
    """Standing on all legs tells their sum alone."""
    found = weigh_feet(_vertical_n(_ALL, np.zeros(2))[None], _UNKNOWN_REL, _MASS_KG)
    assert found.sigma_rel.min() > 0.18


def test_a_mass_that_is_a_fifth_off_is_named() -> None:
    found = weigh_feet(_ALONG_N, _UNKNOWN_REL, 1.25 * _MASS_KG)
    assert found.doubt.endswith("check the mass of 2.5 kg")


def test_a_robot_that_leans_on_something_is_refused() -> None:
    carried_rel = np.where(np.arange(10) == 2, 0.5, 1.0)[:, None]
    with pytest.raises(CalibrationError, match=r"the feet carry .* of 2 kg weighs 19\.6 N: check the mass"):
        weigh_feet(carried_rel * _ALONG_N, _UNKNOWN_REL, _MASS_KG)
    with pytest.raises(CalibrationError, match="no time in which every foot stands still or hangs"):
        weigh_feet(np.zeros((2, 6)), _UNKNOWN_REL, _MASS_KG)
