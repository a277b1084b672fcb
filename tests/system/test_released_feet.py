"""Robots with the other released feet walk at their own loads: one line of configuration each."""

from collections import defaultdict
from pathlib import Path

import can
import pytest

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.force import FORCE_ID, force_step_mn
from footsense.client import Link
from tests.system.command import run_json

#: Foot type, legs, scene, largest force of its training and of the scene [N].
ROBOTS = [
    ("hexapod-2kg", "lf: 0, lm: 1, lr: 2, rf: 3, rm: 4, rr: 5", "hexapod_2kg", 18.0, 11.8),
    ("quadruped-12kg", "lf: 0, lr: 1, rf: 2, rr: 3", "quadruped_12kg", 225.0, 147.0),
]


@pytest.mark.parametrize(
    ("foot_type", "legs", "scene", "max_n", "peak_n"), ROBOTS, ids=[one[0] for one in ROBOTS]
)
@pytest.mark.slow
def test_a_robot_walks_on_its_feet(
    tmp_path: Path, foot_type: str, legs: str, scene: str, max_n: float, peak_n: float
) -> None:
    """At most 2 deg and 3 % on average, and a consumer reads the forces off CAN with the step of these feet."""
    config = tmp_path / "robot.yaml"
    config.write_text(
        f"buses: [{{device: sim, legs: {{{legs}}}}}]\ncan: {{interface: virtual}}\nfoot_type: {foot_type}\n"
    )
    log = tmp_path / "walk.log"
    figures = run_json("--config", config, "--scene", scene, "--duration", "4", "--can-log", log)
    assert figures["faults"] == 0
    assert figures["direction_error_deg"]["mean"] < 2.0
    assert figures["magnitude_error_rel"]["mean"] < 0.03
    assert figures["direction_error_deg"]["loaded_from_n"] == pytest.approx(0.05 * max_n)
    link = Link(force_step_mn=force_step_mn(max_n))
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
