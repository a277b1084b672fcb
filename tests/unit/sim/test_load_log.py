"""Loads from a file: interpolated, repeated, scaled, and refused in one line if they are none."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import footsense
from footsense.daemon.foot_types import released_path
from footsense.errors import ConfigError
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.sim.loads import load_log
from footsense.sim.loads.load_log import RepeatedLog
from footsense.sim.loads.log_table import LogTable
from footsense.sim.rubber import ViscoelasticRubber
from footsense.sim.scene import load_scene

MS = 1_000_000
LEGS = ("lf", "rf")


def arrays(**changed: Any) -> dict[str, Any]:
    """A second of two feet: lf carries 2 N, then 4 N, then swings; rf stands at 1 N, its normal leaning by 30 deg."""
    t_s = np.linspace(0.0, 1.0, 11)
    force_n, normal = np.zeros((11, 2, 3)), np.tile([0.0, 0.0, 1.0], (11, 2, 1))
    force_n[:6, 0, 2], force_n[3:6, 0, 2] = 2.0, 4.0
    normal[:6, 0] = (0.6, 0.0, 0.8)
    force_n[:, 1], normal[:, 1] = (0.0, 0.5, 0.75**0.5), (0.0, 0.5, 0.75**0.5)
    return {"legs": np.array(LEGS), "t_s": t_s, "force_n": force_n, "normal": normal} | changed


def saved(folder: Path, **changed: Any) -> Path:
    file = folder / "walk.npz"
    np.savez(file, **{name: array for name, array in arrays(**changed).items() if array is not None})
    return file


def test_a_log_is_interpolated_and_repeated_from_its_start_on(tmp_path: Path) -> None:
    """Nothing before it; a rise of 0.1 s at first, none at the second time."""
    load = RepeatedLog(saved(tmp_path), from_ns=1000 * MS)
    assert load.contact("lf", 1000 * MS - 1).force_n[2] == 0.0
    down_n = [load.contact("lf", t_ms * MS).force_n[2] for t_ms in (1050, 1100, 1250, 1400, 1525, 1550, 1700)]
    np.testing.assert_allclose(down_n, [1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(load.contact("lf", 2050 * MS).force_n[2], 2.0)
    np.testing.assert_allclose(load.contact("rf", 1730 * MS).force_n, [0.0, 0.5, 0.75**0.5])


def test_the_normal_of_a_lift_off_is_that_of_the_load(tmp_path: Path) -> None:
    """Between the last loaded row and the first in the air, whose normal is up."""
    load = RepeatedLog(saved(tmp_path), from_ns=0)
    np.testing.assert_allclose(load.contact("lf", 560 * MS).normal, [0.6, 0.0, 0.8])


def test_a_log_is_scaled_to_a_peak(tmp_path: Path) -> None:
    load = RepeatedLog(saved(tmp_path), 0, peak_force_n=1.0)
    assert load.contact("lf", 400 * MS).force_n[2] == pytest.approx(1.0)
    assert np.linalg.norm(load.contact("rf", 400 * MS).force_n) == pytest.approx(0.25)


def test_the_table_of_a_log_is_the_foot(tmp_path: Path) -> None:
    """Less than a converter's noise between the rows of a walk in any round, and in the air before it."""
    t_s = np.linspace(0.0, 1.0, 1001)
    lean_rad = 0.4 * np.cos(2.0 * np.pi * t_s)
    normal = np.stack([np.sin(lean_rad), 0.0 * t_s, np.cos(lean_rad)], axis=1)
    force_n = 0.8 * np.maximum(np.sin(4.0 * np.pi * t_s), 0.0)[:, None] * normal
    both = {"force_n": np.stack([force_n] * 2, axis=1), "normal": np.stack([normal] * 2, axis=1)}
    foot = Specimen(FootResponse.load(released_path("response.npz")))
    load = RepeatedLog(saved(tmp_path, t_s=t_s, **both), from_ns=1000 * MS)
    table = LogTable(foot, load, "lf")
    for t_us in (500_000, 1_030_300, 1_100_500, 1_220_900, 1_450_000, 1_700_700, 2_050_500, 4_130_100):
        at_normal, at_n = load.contact("lf", t_us * 1000)
        direct_pf = foot.capacitance_pf(at_normal[None], at_n[None])[0]
        np.testing.assert_allclose(table.capacitance_pf(t_us * 1000), direct_pf, atol=2e-4)


def test_the_table_of_a_log_remembers_what_the_rubber_does(tmp_path: Path) -> None:
    """Row by row as the rubber itself through two rounds; later ones are as the second."""
    foot = Specimen(FootResponse.load(released_path("response.npz")))
    load = RepeatedLog(saved(tmp_path), from_ns=0, peak_force_n=0.5)
    table = LogTable(foot, load, "rf", ViscoelasticRubber())
    rubber = ViscoelasticRubber()
    for t_ms in range(0, 1900, 100):
        normal, force_n = rubber.next_effective_load(t_ms * MS, *load.contact("rf", t_ms * MS))
        if t_ms == 1000:  # the last row of a round is the first of the next
            continue
        direct_pf = foot.capacitance_pf(normal[None], force_n[None])[0]
        np.testing.assert_allclose(table.capacitance_pf(t_ms * MS), direct_pf, atol=1e-3)
    np.testing.assert_allclose(table.capacitance_pf(1550 * MS), table.capacitance_pf(7550 * MS))


def scene(folder: Path) -> Path:
    file = folder / "scene.yaml"
    file.write_text("description: x\nload: {kind: log, file: walk.npz, peak_force_n: 0.5}\nlead_in_s: 0.5\n")
    return file


def test_a_scene_without_its_log_says_where_it_names_it(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"scene\.yaml:2: load\.file: .*walk\.npz: no such file"):
        load_scene(str(scene(tmp_path)))


def test_the_table_of_a_log_has_rubber_but_no_warming(tmp_path: Path) -> None:
    saved(tmp_path)
    file = scene(tmp_path)
    text = file.read_text() + "gait_table: true\neffects: {"
    file.write_text(text + "rubber: true, creep_spread_rel: 0.01}\n")
    assert load_scene(str(file)).gait_table
    file.write_text(text + "warming: {from_s: 0, over_s: 1, kelvin: 20}}\n")
    with pytest.raises(ConfigError, match=r"scene\.yaml:5: effects\.warming: makes the rubber softer"):
        load_scene(str(file))


def test_a_scene_names_a_log_beside_it_and_needs_a_log_of_every_leg(tmp_path: Path) -> None:
    """The truth is the log's; another robot would have legs in the air that should walk."""
    saved(tmp_path)
    file = scene(tmp_path)
    robot = tmp_path / "robot.yaml"
    robot.write_text("buses: [{device: sim, legs: {lf: 0, rf: 1}}]\ncan: {interface: virtual}\n")
    walk = footsense.simulate(file, duration_s=0.8, config=robot)
    assert walk.true_force_n is not None
    row = int(np.searchsorted(walk.t_s, 0.7))
    expected = load_scene(str(file)).load.build(500 * MS)
    felt_n = np.array(
        [[expected.contact(leg, t_ms * MS).force_n for leg in LEGS] for t_ms in range(600, 801)]
    )
    assert np.abs(walk.true_force_n[row] - felt_n).max(axis=(1, 2)).min() < 0.01
    with pytest.raises(ConfigError, match=r"walk.npz: has no leg lm: it has lf, rf, this robot lf, lm, lr, "):
        footsense.simulate(file, duration_s=0.1)


UP = arrays()["normal"]


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        (
            {"normal": None},
            "no log of loads, a file of numpy arrays (.npz): it has no array normal, of legs, t_s,",
        ),
        ({"legs": np.array(["lf", "lf"])}, "legs are different names, such as lf, lr, rf, rr"),
        ({"legs": np.array([1, 2])}, "legs are different names"),
        ({"legs": np.array(LEGS, object)}, "Object arrays cannot be loaded when allow_pickle=False"),
        ({"t_s": np.array([0.0])}, "t_s has two times at least, got the shape (1,)"),
        ({"t_s": np.zeros(11)}, "t_s does not rise"),
        ({"t_s": np.full(11, np.nan)}, "t_s has something that is no finite number"),
        ({"force_n": np.ones((11, 6))}, "force_n has the shape (11, 2, 3), by legs and t_s, got (11, 6)"),
        ({"force_n": np.full((11, 2, 3), np.inf)}, "force_n has something that is no finite number"),
        ({"force_n": np.full((11, 2, 3), "1")}, "force_n has something that is no finite number"),
        ({"force_n": np.zeros((11, 2, 3))}, "force_n is zero everywhere"),
        ({"force_n": -arrays()["force_n"]}, "force_n pulls at a foot; it is the ground's force on the foot"),
        ({"normal": 2.0 * UP}, "normal has unit vectors, got lengths from 2 to 2"),
        (
            {"normal": UP[:, :, ::-1]},
            "normal leans to an elevation of 0 deg under load; the foot's response is",
        ),
    ],
)
def test_a_file_that_is_no_log_is_one_line(tmp_path: Path, changed: dict[str, Any], says: str) -> None:
    file = saved(tmp_path, **changed)
    with pytest.raises(ConfigError, match=re.escape(says)) as refusal:
        RepeatedLog(file, 0)
    assert str(file) in str(refusal.value)
    assert len(str(refusal.value)) < 250


def test_files_without_arrays_and_files_without_end_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "walk.npz"
    with pytest.raises(ConfigError, match=r"cannot read the log .*walk.npz: No such file or directory"):
        RepeatedLog(file, 0)
    file.write_text("t_s, force_n")
    with pytest.raises(ConfigError, match=r"walk.npz is no log of loads, .*: File is not a zip file"):
        RepeatedLog(file, 0)
    np.savez_compressed(file, **arrays(more=np.zeros(20_000)))
    monkeypatch.setattr(load_log, "MAX_LOG_BYTES", 100_000)
    with pytest.raises(ConfigError, match=r"it unpacks to more than 100000 bytes"):
        RepeatedLog(file, 0)
    np.savez(file, **arrays(more=np.zeros(20_000)))
    with pytest.raises(ConfigError, match=r"has more than the 100000 bytes that are read"):
        RepeatedLog(file, 0)
