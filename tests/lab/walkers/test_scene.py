"""A robot walks in MuJoCo on our feet, from the command line to its forces."""

import json
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

import footsense
import footsense.errors
from footsense.config import SMALL_BOARD, load_config
from footsense.daemon.walker_scene import scene_of
from footsense.errors import ConfigError, FootsenseError
from footsense.lab.walkers.robots import GRAVITY_M_S2
from footsense.lab.walkers.simulate import WalkerLog
from tests.system.command import footsense as command
from tests.system.command import one_line_error

QUADRUPED = """buses: [{device: sim, legs: {lf: 0, lr: 1, rf: 2, rr: 3}}]
can: {interface: virtual}
foot_type: quadruped-12kg
"""


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file of a quadruped, and keep walks beside it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    file = tmp_path / "quadruped.yaml"
    file.write_text(QUADRUPED)
    return file


@pytest.mark.slow
def test_a_quadruped_trots_on_its_feet(config: Path, tmp_path: Path) -> None:
    """Its feet feel its weight, and the forces that are sent are near what they feel."""
    walk = footsense.simulate("walker:trot-fast", duration_s=2.0, config=config)
    (file,) = tmp_path.glob("cache/footsense/walkers/*/quadruped-12kg_trot-fast_flat_1_2s.npz")
    log = WalkerLog.load(file)
    assert walk.legs == log.legs
    assert walk.true_force_n is not None
    walked = walk.t_s > 1.2
    weight_n = 12.0 * GRAVITY_M_S2
    assert walk.true_force_n[walked, :, 2].sum(axis=1).mean() == pytest.approx(weight_n, rel=0.15)
    for felt_n in walk.true_force_n[walked][::40]:  # each cycle is between two samples of the log
        assert np.abs(log.force_n - felt_n).max(axis=(1, 2)).min() < 0.03 * weight_n
    both = walked[:, None] & walk.usable & (walk.true_force_n[..., 2] > 20.0)
    error_n = np.linalg.norm(walk.force_n[both] - walk.true_force_n[both], axis=1)
    assert np.median(error_n) < 0.1 * weight_n


@pytest.mark.slow
def test_the_command_says_who_walks_and_that_a_gait_is_none(config: Path) -> None:
    result = command(
        "run", "--scene", "walker:stand", "--config", config, "--duration", "0.5", "--summary", "text"
    )
    assert result.stdout.startswith(
        "quadruped-12kg walks in MuJoCo, stand on flat: its own forces, repeated every 2 s\n"
    ), result.stderr
    wrong = command("run", "--scene", "walker:trott", "--config", config)
    assert one_line_error(wrong, 78).startswith(
        "scene walker:trott: no gait 'trott': there are walk, trot-slow, "
    )


def test_a_scene_that_cannot_be_is_one_line(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    four = load_config(config)
    for name, robot, says in (
        ("walker:walk:mud", four, "no ground 'mud': there are flat, slope-10, "),
        (
            "walker:walk",
            replace(four, foot_type="./feet/my-foot"),
            "no robot is known that walks on foot type 'my-foot'",
        ),
        (
            "walker:walk",
            replace(SMALL_BOARD, foot_type="quadruped-12kg"),
            "has the legs lf, lr, rf, rr, not lm, rm",
        ),
    ):
        with pytest.raises(ConfigError, match=f"^scene {name}: .*{says}"):
            scene_of(name, robot)
    monkeypatch.setattr(footsense.errors, "find_spec", lambda _: None)
    with pytest.raises(
        FootsenseError, match=r"^scene walker:walk needs mujoco; .* pip install .* -e '.\[walkers\]'"
    ):
        scene_of("walker:walk", four)


@pytest.mark.slow
def test_a_walk_is_written_for_a_scene(config: Path, tmp_path: Path) -> None:
    """With what it cost; the paper's foot feels as much as it can."""
    file = tmp_path / "walk.npz"
    result = command("lab", "walk", "tripod", file, "--robot", "hexapod-300g", "--duration", "1.5", "--json")
    assert result.returncode == 0, result.stderr
    figures = json.loads(result.stdout)
    assert figures["seconds_per_simulated_second"] > 0.0
    assert 0.3 < figures["peak_over_weight"] < 3.0
    assert figures["n_touches"] >= 6
    (tmp_path / "scene.yaml").write_text(
        "description: x\nload: {kind: log, file: walk.npz, peak_force_n: 0.5}\n"
    )
    load = scene_of(str(tmp_path / "scene.yaml"), SMALL_BOARD).load.build(0)
    felt_n = [np.linalg.norm(load.contact("lm", ms * 1_000_000).force_n) for ms in range(100, 1500)]
    assert 0.2 < max(felt_n) < 0.6
