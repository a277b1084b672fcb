"""Board `fdc1004_columns` from end to end: it walks on two buses, and says what is broken or does not fit."""

from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from footsense.cli import main
from footsense.config import SMALL_BOARD, Config
from footsense.config.contradictions import warnings
from footsense.config.sections import Bus
from footsense.daemon.foot_types import released_path
from footsense.daemon.models import load_models
from footsense.daemon.recording_header import board_mismatch_reason
from footsense.errors import ConfigError, ModelError
from footsense.foot.network_card import NETWORK_FILES
from footsense.frames import USABLE, Cause, Cycle, State, Vector
from footsense.sim.faults import scene_faults
from footsense.sim.faults.scene_faults import Fault
from footsense.sim.scene import Effects, Scene
from footsense.sim.scene_loads import Tripod, Unloaded
from tests.support.seen import walked as walk_and_see

TWO_BUSES = (
    Bus(device="sim0", legs={"lf": 0, "lm": 1, "lr": 2}),
    Bus(device="sim1", legs={"rf": 0, "rm": 1, "rr": 2}),
)
ROBOT = msgspec.structs.replace(SMALL_BOARD, board="fdc1004_columns", buses=TWO_BUSES)
REAL = Effects(converter_noise=True, converter_clock_rel=0.01)
AT_1_S: dict[str, Any] = {"at_s": 1.0, "leg": "lm"}


walked = partial(walk_and_see, robot=ROBOT)


def test_it_walks_and_replays(tmp_path: Path) -> None:
    """377 conversions a second at 40 us a transaction, no fault after the tare, the force right to a centinewton."""
    scene = Scene(
        description="A walk.",
        load=Tripod(period_s=1.0, duty_rel=0.6, peak_force_n=1.0),
        host_cost_us=40.0,
        effects=REAL,
    )
    errors_n: list[Vector] = []

    def felt(cycle: Cycle, true_n: Vector) -> None:
        errors_n.append((cycle.forces.force_n - true_n)[np.isin(cycle.forces.state, sorted(USABLE))])

    file = tmp_path / "walk.mcap"
    cycles = walked(scene, 3.0, felt, record=file)
    assert all(
        (cycle.forces.state == State.VALID).all() for cycle in cycles if cycle.forces.t_sent_ns > 0.8e9
    )
    assert np.sqrt(np.mean(np.concatenate(errors_n) ** 2)) < 0.015
    assert 366 < len(cycles) / 3.0 < 381  # the start takes 60 ms
    result = CliRunner().invoke(main, ["replay", str(file), "--check"])
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("fault", "state", "cause", "mask"),
    [
        (scene_faults.ConverterSilent(column=1, **AT_1_S), State.ABSENT, Cause.NO_ANSWER, None),
        (scene_faults.ConvertersCollide(column=2, **AT_1_S), State.ABSENT, Cause.NO_ANSWER, None),
        (scene_faults.TranslatorDead(**AT_1_S), State.ABSENT, Cause.NO_ANSWER, None),
        (scene_faults.StuckConverter(column=0, **AT_1_S), State.CONVERTER_FAULT, Cause.NEVER_FINISHES, None),
        (scene_faults.WrongChip(**AT_1_S), State.ABSENT, Cause.WRONG_CHIP, None),
        (scene_faults.ElementOpen(element=4, **AT_1_S), State.DEGRADED, Cause.ELEMENT_OPEN, 0b000_010_000),
        (scene_faults.BrokenColumn(column=2, **AT_1_S), State.DEGRADED, Cause.COLUMN_OPEN, 0b100_100_100),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, msgspec.Struct) else "",
)
def test_what_breaks_has_its_own_words(fault: Fault, state: State, cause: Cause, mask: int | None) -> None:
    """The leg says what it is, and the other legs go on."""
    scene = Scene(
        description="Something breaks.", load=Unloaded(), host_cost_us=40.0, effects=REAL, faults=(fault,)
    )
    last = walked(scene, 3.0)[-1].forces
    assert (State(last.state[1]), Cause(last.cause[1])) == (state, cause)
    assert mask is None or last.fault_mask[1] == mask
    assert (last.state[[0, 2, 3, 4, 5]] == State.VALID).all()


@pytest.mark.parametrize(
    ("robot", "fault", "says"),
    [
        (ROBOT, scene_faults.BrokenRow(row=1, **AT_1_S), "is for row lines and their switch"),
        (ROBOT, scene_faults.SwitchIgnoresWrites(**AT_1_S), "is for row lines and their switch"),
        (SMALL_BOARD, scene_faults.TranslatorDead(**AT_1_S), "is for board fdc1004_columns"),
    ],
)
def test_a_fault_of_a_part_that_a_board_does_not_have_is_refused(
    robot: Config, fault: Fault, says: str
) -> None:
    scene = Scene(description="Nothing breaks.", load=Unloaded(), faults=(fault,))
    with pytest.raises(ConfigError, match=says):
        walked(scene, 1.0, robot=robot)


def test_a_bus_that_does_not_carry_the_rate_says_which_it_does(caplog: pytest.LogCaptureFixture) -> None:
    """Before the start by its clock alone, at the start as it was measured; two buses are enough at 40 us."""
    one_bus = msgspec.structs.replace(ROBOT, buses=SMALL_BOARD.buses)
    (told,) = [text for text in warnings(one_bus) if text.startswith("buses[0]")]
    assert "sim carries at most 328 conversions/s of each converter, 400 are asked for" in told
    assert not [text for text in warnings(ROBOT) if text.startswith("buses")]
    for host_cost_us, is_slow in ((40.0, False), (100.0, True)):
        caplog.clear()
        walked(Scene(description="", load=Unloaded(), host_cost_us=host_cost_us), 0.1)
        slow = [text for text in caplog.messages if "conversions/s of each converter" in text]
        assert len(slow) == (2 if is_slow else 0)
    assert slow[0].startswith("sim0 carries at most 270 conversions/s")


def test_readings_of_another_board_are_told() -> None:
    """A configuration of one board does not fit a recording of the other: three elements have one time, or one."""
    scene = Scene(description="It hangs.", load=Unloaded())
    of_rows, of_elements = (walked(scene, 0.3, robot=robot)[-1].scan for robot in (ROBOT, SMALL_BOARD))
    assert board_mismatch_reason(of_rows, ROBOT) is None
    assert board_mismatch_reason(of_elements, SMALL_BOARD) is None
    for scan, robot, found in ((of_rows, SMALL_BOARD, 3), (of_elements, ROBOT, 1)):
        reason = board_mismatch_reason(scan, robot)
        assert reason is not None
        assert reason.startswith(f"its readings are of {found} element")
        assert robot.board in reason


def test_a_network_of_another_board_is_one_clear_line(tmp_path: Path) -> None:
    """Of either; and a foot type that has none for the board says what makes it."""
    files = {scan: released_path(name) for scan, name in NETWORK_FILES.items()}
    for robot, of_other in ((ROBOT, files["elements"]), (SMALL_BOARD, files["rows"])):
        with pytest.raises(
            ModelError, match=f"a network for a scan of .*; board {robot.board} converts .*lab build"
        ):
            load_models(msgspec.structs.replace(robot, model=str(of_other)))
    for file in files["elements"].parent.iterdir():
        if file.name != NETWORK_FILES["rows"]:
            (tmp_path / file.name).symlink_to(file)
    with pytest.raises(
        ModelError, match=r"no such network for board fdc1004_columns; .*--board fdc1004_columns"
    ):
        load_models(msgspec.structs.replace(ROBOT, foot_type=str(tmp_path)))
