"""Scenes in which the CAN bus breaks, with the whole service: what a consumer hears."""

from pathlib import Path

import can
import msgspec
import pytest

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.force import FORCE_ID
from footsense.can.interface import Can
from footsense.config import SMALL_BOARD
from footsense.daemon.service import open_service
from footsense.errors import ConfigError
from footsense.sim.faults.scene_faults import CanBusOff, CanDown, CanFault, CanNoAck
from footsense.validation.fault_trial import WALK_SCENE, can_trial


@pytest.mark.parametrize(
    ("fault", "back_s"),
    [
        (CanNoAck(at_s=0.5, until_s=0.9), 0.03),
        (CanBusOff(at_s=0.5, until_s=0.9), 0.15),  # the time until the restart
        (CanDown(at_s=0.5, until_s=0.9, unplugged=True), 0.3),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, CanFault) else "",
)
def test_a_consumer_hears_no_old_force_and_soon_all_legs_again(fault: CanFault, back_s: float) -> None:
    """The silence is as long as the fault and no longer than the way back; nothing comes late after it."""
    figures = can_trial(fault, duration_s=1.6)
    assert figures.recovery_s is not None
    assert figures.recovery_s < back_s
    assert 0.38 < figures.longest_silence_s < 0.4 + back_s + 0.05
    assert figures.longest_frame_delay_s < 0.031  # two forces and the time of a full queue
    assert figures.max_age_on_arrival_s < 0.035  # the same, and the age when sent


def test_a_robot_on_socketcan_logs_the_frames_of_a_simulated_can_alone(tmp_path: Path) -> None:
    """A scene that breaks CAN simulates it; the frames of the machine's own interface are `candump`'s."""
    robot = msgspec.structs.replace(SMALL_BOARD, can=Can(interface="socketcan", channel="can0"))
    log = tmp_path / "can.log"
    with (
        pytest.raises(ConfigError, match="candump -l can0"),
        open_service(robot, WALK_SCENE, real_time=False, can_log=log),
    ):
        pass
    breaks = msgspec.structs.replace(WALK_SCENE, faults=(CanDown(at_s=0.5),))
    with open_service(robot, breaks, real_time=False, can_log=log) as service:
        service.run(until_ns=100_000_000)
    assert {NODE_IDS[leg] + FORCE_ID for leg in robot.legs} <= {m.arbitration_id for m in can.LogReader(log)}
