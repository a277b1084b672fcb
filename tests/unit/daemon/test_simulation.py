"""What a simulation says of itself: where its frames go, and that this computer is too slow for it."""

import logging
from contextlib import closing
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from firmware_interface.can.codes import Flag, NmtState
from firmware_interface.can.commands import COMMAND_ID
from firmware_interface.can.force import FORCE_ID
from firmware_interface.can.reports import HEARTBEAT_ID, decode_heartbeat
from firmware_interface.can.socketcan import pack_frame
from footsense.can.interface import Can
from footsense.cli import main
from footsense.client import Motions
from footsense.config import SMALL_BOARD
from footsense.daemon.can_output import another_sends, frames_destination, others_hear
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.loop import Loop
from footsense.daemon.models import load_models
from footsense.daemon.service import open_service
from footsense.daemon.simulation import PacedSource
from footsense.estimation.pipeline import Pipeline
from footsense.frames import LEGS, CapFrame, Cycle, LegMotion, Reading, State, StepPhase
from footsense.ports import Observer
from footsense.recording.replay import Replay
from footsense.sim.scene import load_scene
from footsense.wires.opening import open_wire
from tests.support.can_robot import MS, FakeClock, Robot
from tests.support.cycles import same

PERIOD_NS = 20 * MS


class SlowSource:
    """A simulation whose frames take real time.

    Attributes:
        played: Time of its frames.
        real: Time that it takes.
        cost_ns: Of each frame, in turn [ns].
    """

    def __init__(self, played: FakeClock, real: FakeClock, cost_ns: list[int]) -> None:
        self.played, self.real, self.cost_ns = played, real, iter(cost_ns)

    def read(self) -> CapFrame | None:
        """Return the next frame, or None after the last."""
        cost_ns = next(self.cost_ns, None)
        if cost_ns is None:
            return None
        self.played.t_ns += PERIOD_NS
        self.real.t_ns += cost_ns
        shape = len(LEGS), 9
        nothing = np.full(shape, np.nan)
        t_ns, reading = np.zeros(shape, np.int64), np.full(shape, Reading.NO_ANSWER, np.uint8)
        return CapFrame(self.played.t_ns, t_ns, nothing, reading)

    def close(self) -> None: ...


class _RunningClock(FakeClock):
    def __init__(self) -> None:
        self.t_ns = 3600 * 1000 * MS

    def now_ns(self) -> int:
        self.t_ns += 1000
        return self.t_ns


class _States(Observer):
    def __init__(self) -> None:
        self.last: list[State] = []

    def observe(self, cycle: Cycle) -> None:
        self.last = [State(state) for state in cycle.forces.state.tolist()]


class _Flags(Observer):
    def __init__(self) -> None:
        self.degraded: list[bool] = []

    def observe(self, cycle: Cycle) -> None:
        self.degraded.append(bool((cycle.forces.flags & Flag.DEGRADED_TIMING).all()))


class _Controller(Observer):
    """Gait controller that tells the motion of two legs after every third cycle, and falls silent after sixty.

    Attributes:
        seen: Motion of each cycle.
    """

    def __init__(self, settings: Can) -> None:
        self._wire, self._motions = open_wire(settings.address), Motions()
        self.seen: list[LegMotion | None] = []

    def observe(self, cycle: Cycle) -> None:
        n = len(self.seen)
        self.seen.append(cycle.motion)
        for node in (1, 4) if n % 3 == 0 and n < 60 else ():
            told = {"acceleration_m_per_s2": 0.1 * n, "sigma_m_per_s2": 0.5, "up": (0.0, 0.6, 0.8)}
            frame = self._motions.encode(node, **told, phase=StepPhase.STANCE)  # type: ignore[arg-type]
            self._wire.send([pack_frame(*frame)], 0)

    def close(self) -> None:
        self._wire.close()


def test_a_simulation_that_lags_says_so_in_frames_and_heartbeats(
    request: pytest.FixtureRequest, caplog: pytest.LogCaptureFixture
) -> None:
    """From 0.1 s behind real time until it has caught up, and in one line of the log, with its speed until then."""
    robot = Robot(request.node.nodeid, LEGS)
    real = FakeClock()
    slow, fast = [70 * MS] * 10, [0] * 40
    pipeline = pipeline_for(load_models(SMALL_BOARD), Flag.SIMULATED)
    source = PacedSource(
        SlowSource(robot.clock, real, [*fast[:5], *slow, *fast, *slow, *fast]),
        robot.clock,
        real,
        pipeline.set_degraded_timing,
    )
    flags = _Flags()
    with caplog.at_level(logging.WARNING):
        Loop(pipeline, robot.sink, [flags], robot.clock).run_until(source, stop=lambda: False)
    assert flags.degraded[:7] == [False] * 7
    assert (
        flags.degraded[7:30] == [True] * 23
    )  # three cycles make 150 ms of lag, ten 500 ms, which 25 fast ones take off
    assert flags.degraded.count(True) == 2 * flags.degraded[:55].count(True)
    assert not flags.degraded[-1]
    beats = [decode_heartbeat(m.arbitration_id, bytes(m.data)) for m in robot.heard(HEARTBEAT_ID)]
    assert {beat.degraded_timing for beat in beats if beat.state is NmtState.PRE_OPERATIONAL} == {False, True}
    (line,) = (r.getMessage() for r in caplog.records if "pace" in r.getMessage())
    # Lags more than 0.1 s after three frames of 20 ms in 70 ms each.
    assert "cannot keep pace with real time on this computer: it runs at 0.286 of real time" in line
    assert source.real_time_factor == 1.0  # it has caught up
    robot.close()


@pytest.mark.parametrize(("cost_ms", "factor"), [(5, 1.0), (20, 1.0), (50, 0.4)])
def test_the_real_time_factor_is_that_of_all_frames_since_the_first(
    cost_ms: int, factor: float, caplog: pytest.LogCaptureFixture
) -> None:
    """On a clock that has run since long before, and goes on while it is read."""
    played, real, lagging = FakeClock(), _RunningClock(), list[bool]()
    source = PacedSource(SlowSource(played, real, [cost_ms * MS] * 20), played, real, lagging.append)
    while source.read():
        pass
    assert source.real_time_factor == pytest.approx(factor, abs=1e-3)
    assert lagging == [True] * (factor < 1.0)
    assert ["it runs at 0.4 of real time;" in line for line in caplog.messages] == lagging


def test_a_recording_with_changes_of_the_timing_replays_bit_for_bit(tmp_path: Path) -> None:
    """The flag is of the computer that recorded: the replay takes it from there."""
    file, cycles = tmp_path / "late.mcap", iter(range(100))
    with open_service(SMALL_BOARD, load_scene("hanging"), real_time=False, record=file) as service:
        for n, degraded in ((20, True), (40, False)):
            service.run_until(service.source, stop=lambda n=n: next(cycles) >= n)  # type: ignore[misc]
            service.pipeline.set_degraded_timing(degraded)
        service.run_until(service.source, stop=lambda: next(cycles) >= 60)
    result = CliRunner().invoke(main, ["replay", str(file), "--check"])
    assert (result.exit_code, "cycles equal" in result.output) == (0, True), result.output


def test_a_walk_with_motions_replays_bit_for_bit(request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """What a gait controller sends reaches the estimation in the same cycle once more, and so does its end."""
    file = tmp_path / "moved.mcap"
    settings = Can(interface="virtual", channel=request.node.nodeid)
    config = msgspec.structs.replace(SMALL_BOARD, can=settings)
    controller = _Controller(settings)
    with open_service(config, load_scene("tripod"), real_time=False, record=file) as service:
        service.observers.append(controller)
        service.run_until(service.source, stop=lambda: len(controller.seen) >= 90)
    told = [motion for motion in controller.seen if motion is not None]
    assert 8 <= len(told) < 90
    assert (told[0].t_ns > 0).tolist() == [True, False, False, True, False, False]
    assert (told[-1].t_ns == 0).all()
    recorded = [cycle.motion for cycle in Replay(file)]
    assert all(map(same, recorded, controller.seen))
    replayed: list[LegMotion] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Pipeline, "set_motion", lambda _, motion: replayed.append(motion))
        result = CliRunner().invoke(main, ["replay", str(file), "--check"])
    assert (result.exit_code, "cycles equal bit for bit" in result.output) == (0, True), result.output
    assert all(map(same, replayed, told))
    assert len(replayed) == len(told)


@pytest.mark.parametrize(
    ("can", "device", "says"),
    [
        ({"interface": "virtual"}, "sim", "stay within this process"),
        ({"interface": "socketcan"}, "/dev/i2c-1", "stay within this process"),
        ({"interface": "socketcan", "channel": "can3"}, "sim", "go out on can3 of this computer"),
        ({"interface": "udp_multicast"}, "sim", "go out on 239.74.163.2, to programs on this computer alone"),
        (
            {"interface": "udp_multicast", "channel": "239.74.163.9"},
            "sim",
            "on this computer alone: footsense monitor --interface udp_multicast --channel 239.74.163.9",
        ),
    ],
)
def test_a_simulation_says_where_its_frames_go(can: dict[str, str], device: str, says: str) -> None:
    """In one line; a scene in place of a real robot's buses reaches nobody. What others hear is paced."""
    buses = msgspec.structs.replace(SMALL_BOARD.buses[0], device=device)
    config = msgspec.structs.replace(SMALL_BOARD, buses=(buses,), can=Can(**can))  # type: ignore[arg-type]
    line = frames_destination(config, load_scene("tripod"))
    assert says in line
    assert line.startswith("simulated")
    assert "\n" not in line
    assert others_hear(config, load_scene("tripod")) == ("go out on" in line)


def test_faults_of_legs_that_a_robot_does_not_have_are_left_out(caplog: pytest.LogCaptureFixture) -> None:
    """Those of its own legs stay."""
    wired = msgspec.structs.replace(SMALL_BOARD.buses[0], legs={"lf": 0, "rf": 1})
    config = msgspec.structs.replace(SMALL_BOARD, buses=(wired,))
    with open_service(config, load_scene("faults"), real_time=False) as service:
        states = _States()
        service.observers.append(states)
        service.run(until_ns=4_000_000_000)
    (line,) = (r.getMessage() for r in caplog.records if "faults" in r.getMessage())
    assert line == "the scene's faults of lm, lr, rm are left out: this robot has lf, rf"
    assert states.last == [State.DEGRADED, State.ABSENT]


@pytest.mark.parametrize(("can_id", "sends"), [(FORCE_ID + 1, True), (COMMAND_ID + 1, False)])
def test_another_service_on_a_channel_is_heard(
    request: pytest.FixtureRequest, can_id: int, *, sends: bool
) -> None:
    """By its forces, at once; a controller that sends commands is none."""
    clock, can = FakeClock(), Can(interface="virtual", channel=request.node.nodeid)
    with closing(open_wire(can.address)) as heard, closing(open_wire(can.address)) as other:
        other.send([pack_frame(can_id, bytes(8))], 0)
        assert another_sends(heard, clock) is sends
    assert clock.t_ns == (0 if sends else 250 * MS)
