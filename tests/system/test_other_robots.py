"""Robots with other feet and other legs walk at their own loads: what the configuration says is enough."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.force import FORCE_ID, QUALITY_ID
from footsense.client import Link
from footsense.config import load_config
from footsense.frames import Cause
from footsense.sim.scene import load_scene
from footsense.validation.fault_trial import simulate_scene
from tests.system.command import run_json

pytestmark = pytest.mark.slow

#: Foot type, legs, scene, largest force of its training and of the scene [N].
ROBOTS = [
    ("hexapod-2kg", "lf: 0, lm: 1, lr: 2, rf: 3, rm: 4, rr: 5", "hexapod_2kg", 28.8, 11.8),
    ("quadruped-12kg", "lf: 0, lr: 1, rf: 2, rr: 3", "quadruped_12kg", 259.0, 147.0),
]


def walked(
    folder: Path, legs: str, can_options: str, scene: str, more: str = ""
) -> tuple[dict[str, Any], Path]:
    """Walk for four seconds in the scene of the feet, without a fault; return the figures and the CAN log."""
    config, log = folder / "robot.yaml", folder / "walk.log"
    config.write_text(f"buses: [{{device: sim, legs: {{{legs}}}}}]\ncan: {{{can_options}}}\n{more}")
    figures = run_json("--config", config, "--duration", "4", "--can-log", log)
    assert figures["scene"] == scene
    assert figures["faulty_leg_cycles"] == 0
    assert figures["direction_error_deg"]["mean"] < 2.0
    return figures, log


@pytest.mark.parametrize(
    ("foot_type", "legs", "scene", "max_n", "peak_n"), ROBOTS, ids=[one[0] for one in ROBOTS]
)
def test_a_robot_walks_on_its_feet(
    tmp_path: Path, foot_type: str, legs: str, scene: str, max_n: float, peak_n: float
) -> None:
    """At most 2 deg and 5 % on average, and a consumer reads the forces off CAN with the step that it tells."""
    figures, log = walked(tmp_path, legs, "interface: virtual", scene, f"foot_type: {foot_type}\n")
    assert figures["magnitude_error_rel"]["mean"] < 0.05
    assert figures["direction_error_deg"]["loaded_from_n"] == pytest.approx(0.05 * max_n)
    link = Link()
    largest_n: dict[int, float] = defaultdict(float)
    for message in can.LogReader(log):
        now_ns = round(message.timestamp * 1e9)
        link.feed(message.arbitration_id, bytes(message.data), now_ns)
        if (node := message.arbitration_id - FORCE_ID) in NODE_IDS.values() and (
            leg := link.leg(node, now_ns)
        ).usable:
            largest_n[node] = max(largest_n[node], leg.force_n[2])
    assert len(largest_n) == len(legs.split(","))
    for force_n in largest_n.values():
        assert force_n == pytest.approx(peak_n, rel=0.1)  # a rising load is extrapolated


@pytest.mark.parametrize(
    ("foot_type", "legs", "scene"), [one[:3] for one in ROBOTS], ids=[one[0] for one in ROBOTS]
)
def test_healthy_feet_are_not_noisy(tmp_path: Path, foot_type: str, legs: str, scene: str) -> None:
    """In a walk they roll, and lift off twelve times: their motion is not taken for noise."""
    config = tmp_path / "robot.yaml"
    config.write_text(
        f"buses: [{{device: sim, legs: {{{legs}}}}}]\ncan: {{interface: virtual}}\nfoot_type: {foot_type}\n"
    )
    walk = simulate_scene(load_scene(scene), load_config(config), 12.0)
    assert Cause.NOISY not in walk.cause


def test_eight_legs_walk_in_two_groups_of_four(tmp_path: Path) -> None:
    """One group carries while the other swings; a client reads both."""
    places = ", ".join(f"{leg}: {place}" for place, leg in enumerate(NODE_IDS))
    _, log = walked(tmp_path, places, "interface: virtual", "tripod", "board: fdc1004")
    link, z_n = Link(), defaultdict(list)
    for message in can.LogReader(log):
        now_ns = round(message.timestamp * 1e9)
        link.feed(message.arbitration_id, bytes(message.data), now_ns)
        if message.arbitration_id == QUALITY_ID + 8:
            views = {leg: link.leg(node, now_ns) for leg, node in NODE_IDS.items()}
            if all(view.usable for view in views.values()):
                for leg, view in views.items():
                    z_n[leg].append(view.force_n[2])
    first, second = (
        [z_n[leg] for leg in group] for group in (("lf", "rm", "lr", "r4"), ("rf", "lm", "rr", "l4"))
    )
    assert len(z_n["lf"]) > 200
    together = np.atleast_2d(np.corrcoef(first + second))
    assert together[:4, :4].min() > 0.95
    assert together[4:, 4:].min() > 0.95
    assert together[:4, 4:].max() < 0.0
