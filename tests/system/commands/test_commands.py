"""Commands by CAN, from a controller on the same bus: obeyed, answered, and refused with a reason."""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import can
import pytest

from firmware_interface.can.codes import NODE_IDS, NmtState
from firmware_interface.can.commands import ANSWER, ANSWER_ID, COMMAND_ID, encode_command
from firmware_interface.can.reports import HEARTBEAT_ID, encode_heartbeat
from firmware_interface.can.socketcan import pack_frame
from footsense.client.commander import Commander
from footsense.config import SMALL_BOARD
from footsense.daemon.service import Service, open_service
from footsense.frames import LEGS, CommandKind, Cycle, Result, State
from footsense.sim.scene import load_scene
from footsense.wires.opening import open_wire
from tests.support.can_robot import FakeClock
from tests.system.command import footsense, one_line_error, robot

NODE_LM = 2
SCENE = """
description: Every foot is pressed a second after the start.
load: {kind: constant, force_n: [0.1, 0.0, 0.5]}
lead_in_s: 1.0
"""


class Controller:
    """An observer that sends commands at given times and keeps what comes back."""

    def __init__(self, bus: can.BusABC, commands: dict[int, CommandKind]) -> None:
        self._bus = bus
        self._commands = commands
        self._counter = 0
        self.answers: list[tuple[CommandKind, Result]] = []
        self.states: list[State] = []

    def observe(self, cycle: Cycle) -> None:
        self.states.append(State(int(cycle.forces.state[1])))
        while (message := self._bus.recv(timeout=0)) is not None:
            if message.arbitration_id == ANSWER_ID + NODE_LM:
                answer = ANSWER.decode(message.arbitration_id, bytes(message.data))
                self.answers.append((CommandKind(answer.command_kind), Result(answer.result)))
        kind = self._commands.get(cycle.scan.sequence)
        if kind is not None:
            data = encode_command(NODE_LM, self._counter, kind)
            self._counter += 1
            self._bus.send(can.Message(arbitration_id=COMMAND_ID + NODE_LM, data=data, is_extended_id=False))

    def close(self) -> None:
        pass


@pytest.fixture
def scene(tmp_path: Path) -> str:
    """A scene file with half a newton on every foot after the first second."""
    file = tmp_path / "pressed.yaml"
    file.write_text(SCENE)
    return str(file)


def test_a_tare_is_granted_unloaded_and_refused_loaded(scene: str) -> None:
    """The start's own tare is told too; then DONE in the air, LOADED on the ground, where no leg is stopped either."""
    with (
        can.Bus(interface="virtual", channel=SMALL_BOARD.can.channel) as bus,
        open_service(SMALL_BOARD, load_scene(scene), real_time=False) as service,
    ):
        stopped_and_started = {270: CommandKind.STOP, 300: CommandKind.START, 810: CommandKind.STOP}
        controller = Controller(bus, {180: CommandKind.TARE, 540: CommandKind.TARE, **stopped_and_started})
        service.observers.append(controller)
        service.run(until_ns=2_500_000_000)
    assert controller.answers == [
        (CommandKind.TARE, Result.DONE),
        (CommandKind.TARE, Result.DONE),
        (CommandKind.STOP, Result.DONE),
        (CommandKind.START, Result.DONE),
        (CommandKind.TARE, Result.LOADED),
        (CommandKind.STOP, Result.LOADED),
    ]
    assert controller.states[290] is State.STOPPED
    assert controller.states[-1] is State.VALID


class ServiceTime(NamedTuple):
    """The clock of a simulated service, which runs on while a consumer sleeps, for a time at least."""

    service: Service
    step_ns: int = 100_000_000

    def now_ns(self) -> int:
        return self.service.clock.now_ns()

    def sleep_until_ns(self, t_ns: int) -> None:
        self.service.run(until_ns=max(t_ns, self.now_ns() + self.step_ns))


def test_the_command_tares_legs_and_tells_refusals(tmp_path: Path) -> None:
    """All that are heard in the air, one on the ground; and a leg that this robot does not have."""
    file = tmp_path / "pressed.yaml"
    file.write_text(SCENE.replace("lead_in_s: 1.0", "lead_in_s: 3.0"))
    with (
        open_service(SMALL_BOARD, load_scene(str(file)), real_time=False) as service,
        closing(open_wire(SMALL_BOARD.can.address)) as wire,
    ):
        clock = ServiceTime(service)
        commander = Commander(clock)
        in_the_air = list(commander.command(wire, CommandKind.TARE))
        clock.sleep_until_ns(4_000_000_000)
        on_the_ground = {
            answer.leg: answer.result for answer in commander.command(wire, CommandKind.TARE, ["lm", "l4"])
        }
    assert on_the_ground == {"l4": None, "lm": Result.LOADED}
    assert {answer.leg: answer.result for answer in in_the_air} == dict.fromkeys(LEGS, Result.DONE)


@pytest.mark.slow
def test_each_of_many_commands_in_a_row_has_an_answer(scene: str) -> None:
    """A refusal comes at once; what is commanded again then is neither a repetition nor one too many in a second."""
    with (
        open_service(SMALL_BOARD, load_scene(scene), real_time=False) as service,
        closing(open_wire(SMALL_BOARD.can.address)) as wire,
    ):
        clock = ServiceTime(service, step_ns=20_000_000)
        clock.sleep_until_ns(2_500_000_000)
        commander = Commander(clock)
        kinds = [CommandKind.TARE] * 12 + [CommandKind.STOP, CommandKind.START]
        answers = [next(commander.command(wire, kind, ["lm"], [NODE_LM])) for kind in kinds]
    assert [answer.result for answer in answers] == [Result.LOADED] * 13 + [Result.DONE]
    assert answers[-2].refusal("can0").startswith("not stopped: the foot is in contact")


class NoAnswer(NamedTuple):
    """A wire on which a leg is heard that answers no command."""

    def send(self, frames: Sequence[bytes], t_ns: int) -> int:
        del t_ns
        return len(frames)

    def receive(self) -> list[bytes]:
        return [pack_frame(HEARTBEAT_ID + NODE_IDS["lf"], encode_heartbeat(NmtState.OPERATIONAL))]

    def close(self) -> None:
        pass


def test_a_wait_for_an_answer_is_told_once() -> None:
    clock, told = FakeClock(), list[tuple[float, list[str], float]]()
    answers = Commander(clock).command(
        NoAnswer(),
        CommandKind.TARE,
        ["lf"],
        on_wait=lambda legs, s: told.append((clock.t_ns / 1e9, [*legs], s)),
    )
    assert [answer.result for answer in answers] == [None]
    ((at_s, legs, limit_s),) = told
    assert 2.0 < at_s < 2.1  # it listens for a second before
    assert (legs, limit_s) == (["lf"], 20.0)


@pytest.mark.parametrize(
    ("legs", "who"), [(["lf"], "lf: not tared: it is not"), ([], "all: not tared: no leg is")]
)
def test_a_tare_without_a_service_is_one_line(legs: list[str], who: str) -> None:
    """Of a leg, or of all as none is named."""
    result = footsense("tare", *legs, "--channel", "239.74.163.77")
    says = f"{who} heard on 239.74.163.77; is the service running, and is this its channel?"
    assert one_line_error(result, 1) == f"{says} (simulated: with --config deploy/simulated.yaml)"


@pytest.mark.parametrize("command", ["monitor", "tare lf"])
def test_without_can_a_command_names_the_channel_of_a_simulation(command: str) -> None:
    result = footsense(*command.split(), "--channel", "can98")
    assert one_line_error(result, 71).endswith("; of a simulation: 239.74.163.2")


def test_the_channel_is_that_of_the_robot_file(tmp_path: Path) -> None:
    """An option has precedence; what stays within the service's process, or is not executed, is refused at once."""
    file = robot(tmp_path, interface="udp_multicast", channel="239.74.163.78")
    line = one_line_error(footsense("tare", "lf", "--config", file), 78)
    assert "can.commands: this robot executes no commands on 239.74.163.78; set `commands: true`" in line
    file = robot(tmp_path, interface="udp_multicast", channel="239.74.163.78, commands: true")
    assert "not heard on 239.74.163.78" in one_line_error(footsense("tare", "lf", "--config", file), 1)
    absent = footsense("tare", "lf", "lm", "--config", file)
    assert (absent.returncode, "lm: this robot has lf, rf" in absent.stderr) == (2, True)
    other = footsense("tare", "lf", "--config", file, "--channel", "239.74.163.79")
    assert "not heard on 239.74.163.79" in one_line_error(other, 1)
    file = robot(tmp_path)
    assert "stay within the service's process" in one_line_error(
        footsense("tare", "lf", "--config", file), 78
    )
