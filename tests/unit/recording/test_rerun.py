"""A recording, and the bag made of it, as Rerun's own SDK reads them.

Rerun is no package of the development environment: with it come 700 MB. `pip install rerun-sdk` into it runs these.
"""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from footsense.frames import IS_USABLE_STATE, LEGS
from footsense.recording.replay import Replay
from footsense.ros2.bag import write_bag

GOLDEN = Path(__file__).parents[2] / "golden/measured_walk.mcap"


def read(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Return time [ns] and content of the messages on each topic: their bytes, or their fields where Rerun has them."""
    chunk = pytest.importorskip("rerun.chunk")
    found: defaultdict[str, list[tuple[int, Any]]] = defaultdict(list)
    for part in chunk.McapReader(str(path)).stream():
        batch = part.to_record_batch()
        names = [name for name in batch.schema.names if name.endswith(("McapMessage:data", ":message"))]
        for name in names:
            times = batch.column("message_log_time").cast("int64").to_pylist()
            found[part.entity_path] += zip(times, batch.column(name).to_pylist(), strict=True)
    return found


def test_a_recording_has_its_topics_times_and_messages() -> None:
    """Rerun leaves JSON as it is: its bytes are ours."""
    found, cycles = read(GOLDEN), list(Replay(GOLDEN))
    assert found.keys() == {"/scan", "/force", "/gait", "/gait_event", "/event"}
    assert len(found["/scan"]) == len(cycles)
    for (t_ns, [data]), cycle in zip(sorted(found["/force"]), cycles, strict=True):
        message = json.loads(bytes(data))
        assert t_ns == message["t_sent_ns"] == cycle.forces.t_sent_ns
        read_n = [[message[leg][axis] for axis in ("fx_n", "fy_n", "fz_n")] for leg in LEGS]
        np.testing.assert_array_equal(np.array(read_n, np.float64), cycle.forces.force_n)


def test_a_bag_has_values_to_plot(tmp_path: Path) -> None:
    """Rerun decodes ROS 2: each usable force is there, to the bit."""
    bag = tmp_path / "walk"
    write_bag(Replay(GOLDEN), bag)
    found, cycles = read(bag / "walk.mcap"), list(Replay(GOLDEN))
    for row, leg in enumerate(LEGS):
        forces = [message["wrench"]["force"] for _, (message,) in sorted(found[f"/footsense/{leg}/wrench"])]
        usable = [one.forces.force_n[row] for one in cycles if IS_USABLE_STATE[one.forces.state[row]]]
        assert len(forces) > 500
        np.testing.assert_array_equal([[force[axis] for axis in "xyz"] for force in forces], usable)
