"""A robot with eight legs walks: what the configuration says is enough."""

from collections import defaultdict
from pathlib import Path

import can
import numpy as np
import pytest

from firmware_interface.can.all_legs import FORCES4_ID
from firmware_interface.can.codes import NODE_IDS
from footsense.client import Link
from tests.system.command import run_json


@pytest.mark.slow
def test_eight_legs_walk_in_two_groups_of_four(tmp_path: Path) -> None:
    """One group carries while the other swings; a client reads both from the CAN FD frames of six legs and of two."""
    config = tmp_path / "robot.yaml"
    places = ", ".join(f"{leg}: {place}" for place, leg in enumerate(NODE_IDS))
    config.write_text(
        f"buses: [{{device: sim, legs: {{{places}}}}}]\ncan: {{interface: virtual, fd: true}}\n"
    )
    log = tmp_path / "walk.log"
    figures = run_json("--config", config, "--scene", "tripod", "--duration", "5", "--can-log", log)
    assert figures["faults"] == 0
    assert figures["direction_error_deg"]["mean"] < 2.0
    link, z_n = Link(), defaultdict(list)
    for message in can.LogReader(log):
        now_ns = round(message.timestamp * 1e9)
        link.feed(message.arbitration_id, bytes(message.data), now_ns)
        if message.arbitration_id == FORCES4_ID:
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
