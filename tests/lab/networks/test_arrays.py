"""Feet of other arrays than the paper's: built, trained, and walked on by the whole service."""

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from footsense.cli import main
from footsense.config import load_config
from footsense.daemon.service import open_service
from footsense.estimation.faults.imputation import Imputation
from footsense.estimation.network import Network
from footsense.foot.files.checksum_trailer import add_checksum
from footsense.lab.build import QUICK_BUILD, build
from footsense.lab.geometry import LoadRange
from footsense.lab.training.export import onnx_model
from footsense.lab.training.gait_readings import random_gaits
from footsense.lab.training.load_cases import random_loads
from footsense.lab.training.snapshot.train import SnapshotTrainingSettings, mean_closure_product_matrix
from footsense.lab.training.train_windowed import WindowTrainingSettings, train_windowed
from footsense.lab.training.windowed_network import predict
from footsense.sim.scene_files import load_scene
from footsense.telemetry.run_statistics import RunStatistics
from footsense.view.recorded import RecordingSource
from footsense.view.signals import signals
from tests.lab.networks.windows import windows_of_array
from tests.support.arrays import response
from tests.support.networks import card_of

pytestmark = [pytest.mark.lab, pytest.mark.slow]

#: A training of seconds.
SETTINGS = WindowTrainingSettings(channels=4, steps=500, batch=256, rate=1e-2)
SMALL = Path(__file__).parents[3] / "docs" / "examples" / "small-2x2.yaml"


def walk(tmp_path: Path, folder: Path, rows: int) -> dict[str, Any]:
    """Return the figures of two seconds of a walk on two feet of this type; replay it bit for bit, and view it."""
    config = tmp_path / "robot.yaml"
    config.write_text(
        f"buses: [{{device: sim, legs: {{lf: 0, rr: 1}}}}]\ncan: {{interface: virtual}}\n"
        f"foot_type: {folder}\nrows: {rows}\n"
    )
    recording = tmp_path / "walk.mcap"
    with open_service(load_config(config), load_scene("tripod"), real_time=False, record=recording) as robot:
        statistics = RunStatistics(robot.legs, robot.true_force_n_at)
        robot.observers.append(statistics)
        robot.run(until_ns=2_000_000_000)
    result = CliRunner().invoke(main, ["replay", str(recording), "--check"])
    assert result.output.endswith("cycles equal bit for bit\n"), result.output
    viewed = RecordingSource(recording)
    viewed.read()
    (kind, *shape) = struct.unpack_from("<IIII", viewed.encoded_second(1))
    viewed.close()
    assert (kind, shape[1:], viewed.damage) == (2, [2, len(signals(rows**2))], "")
    return statistics.summary()


def test_a_foot_of_four_elements_is_built_and_walks(tmp_path: Path) -> None:
    """From its description to forces: solved, trained, exported, checked, and read by the service."""
    recipe = replace(
        QUICK_BUILD,
        random_loads=2_000,
        gaits=12,
        released=SETTINGS,
        paper_cases_only=SnapshotTrainingSettings(steps=1_000, batch=64, masked=False),
    )
    folder = tmp_path / "small-2x2"
    result = build(SMALL, folder, recipe, lambda _: None)
    assert [signal["width"] for signal in result.card["inputs"]] == [12, 12, 4]
    assert len(result.card["closure_rel_max"]) == 4
    assert Network(folder / "network.onnx", 2).card.rows == 2
    assert result.error_table["paper_linear_elastance"].direction_deg < 8.0
    found = walk(tmp_path, folder, 2)
    assert found["faults"] == 0
    assert found["direction_error_deg"]["loaded_frames"] > 30


def test_a_network_of_sixteen_elements_learns_and_is_the_services(tmp_path: Path) -> None:
    """Trained on a made-up foot: the file estimates what the weights do, and the service walks on it."""
    foot = response(4)
    loads = LoadRange(
        max_n=1.0, friction_angle_deg=35, typical_lean_deg=10, min_elevation_deg=45, centred_share=0.5
    )
    rest = random_loads(foot, loads, 500, 1)
    moments = mean_closure_product_matrix(rest.with_symmetric_copies().closure_um / foot.design.gap_um)
    gaits = random_gaits(foot, 3, 24, 400, loads.max_n)
    weights = train_windowed(gaits, rest, foot.design, SETTINGS, Imputation(moments))
    folder = tmp_path / foot.foot_type
    folder.mkdir()
    foot.save(folder / "response.npz")
    card = {**card_of(4), "foot_type": foot.foot_type, "moments": moments.round(9).tolist()}
    network = onnx_model(weights, card).SerializeToString()
    (folder / "network.onnx").write_bytes(add_checksum(network))
    window = windows_of_array(4, 24)
    for ours, jax in zip(
        Network(folder / "network.onnx", 24).estimate(window), predict(weights, window), strict=True
    ):
        np.testing.assert_allclose(ours, jax, atol=2e-4)
    found = walk(tmp_path, folder, 4)
    assert found["faults"] == 0
    assert found["direction_error_deg"]["loaded_frames"] > 30
    assert found["direction_error_deg"]["mean"] < 10.0
