"""Feet that a microcontroller scans: from its records to forces."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest

from firmware_interface.can.codes import USABLE
from footsense.acquisition.mcu_source import McuSource, Serial
from footsense.can.interface import Can
from footsense.config import Config
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.models import load_models
from footsense.daemon.simulation import simulated_robot
from footsense.errors import ConfigError
from footsense.estimation.pipeline import Pipeline
from footsense.frames import CapFrame, Cause, ContactFrame, State
from footsense.sim.faults.scene_faults import ElementOpen, StuckSda
from footsense.sim.robot import SimulatedRobot
from footsense.sim.robot_on_mcu import simulated_mcu
from footsense.sim.scene import Effects, Scene
from footsense.sim.scene_loads import Constant, MeasuredWalk
from tests.support.failing_line import FailingLine, LineFaults

S = 1_000_000_000
MCU = Config(board="mcu", serial=Serial(device="sim"), can=Can(interface="virtual"))
WALK = Scene(
    description="",
    load=MeasuredWalk(peak_force_n=1.0),
    lead_in_s=0.5,
    gait_table=True,
    effects=Effects(converter_noise=True),
)


class Robot(NamedTuple):
    """A simulated robot behind a line.

    Attributes:
        robot: Its feet and its time.
        source: Its scans.
        pipeline: What makes forces of them.
    """

    robot: SimulatedRobot
    source: McuSource
    pipeline: Pipeline

    def run(self, until_ns: int) -> Iterator[tuple[int, ContactFrame]]:
        """Yield the forces of every frame until a time, with the time at which they are ready."""
        while (now_ns := self.robot.clock.now_ns()) < until_ns:
            frame: CapFrame = self.source.read()
            now_ns = self.robot.clock.now_ns()
            yield now_ns, self.pipeline.process(frame, now_ns)[0]


def robot(scene: Scene, faults: LineFaults) -> Robot:
    """Return a robot of a scene on a line that fails."""
    simulated = simulated_robot(MCU, scene)
    assert MCU.serial
    rate_hz, baud = MCU.serial.rate_hz, MCU.serial.baud
    line = FailingLine(
        simulated_mcu(simulated, scene, rate_hz),
        simulated.clock,
        rate_hz=rate_hz,
        bits_per_s=baud,
        faults=faults,
    )
    source = McuSource(line, simulated.clock, Serial(device="sim", rate_hz=rate_hz))
    return Robot(simulated, source, pipeline_for(load_models(MCU), 0))


def test_a_walk_is_felt_as_it_is_and_through_a_line_that_fails() -> None:
    """What a line loses costs a leg three scans; no force of what remains is wrong by it."""
    feet = robot(
        WALK, LineFaults(lost_rel=5e-5, corrupt_rel=5e-5, resets_ns=[2 * S], unplugged_ns=[(3 * S, 3.1 * S)])
    )
    errors_n, ages_ns, usable = [], [], []
    for now_ns, forces in feet.run(4 * S):
        if now_ns < 0.6 * S:
            continue
        good = np.isin(forces.state, sorted(USABLE))
        true_force_n = feet.robot.true_force_n_at(now_ns)
        errors_n.append(np.where(good[:, None], forces.force_n - true_force_n, 0.0))
        ages_ns.append(forces.age_ns[good])
        usable.append((now_ns, good))
    assert np.abs(np.concatenate(errors_n)).max() < 0.2
    # Scans of 5 ms are shorter than those that the network was trained on: 27 mN, against 10 mN at 24 ms.
    assert np.sqrt(np.mean(np.square(errors_n))) < 0.02
    assert np.percentile(np.concatenate(ages_ns), 99) < 12e6
    apart = [good.mean() for now_ns, good in usable if not 3 * S <= now_ns < 3.2 * S]
    assert np.mean(apart) > 0.97
    out = [good for now_ns, good in usable if 3.04 * S < now_ns < 3.1 * S]
    assert out
    assert not np.any(out)
    losses = feet.source.losses
    assert losses["restarts"] == 6
    assert losses["crc"] > 10
    assert losses["length"] > 10


def test_the_feet_and_their_lines_break_as_on_any_board() -> None:
    """An open element degrades its leg; what strikes an I2C bus is refused with the scene's path."""
    load = Constant(force_n=(0.0, 0.1, 0.5), rise_s=0.5)
    broken = Scene(
        description="", load=load, lead_in_s=0.3, faults=(ElementOpen(at_s=0.5, leg="lm", element=4),)
    )
    feet = robot(broken, LineFaults())
    *_, (_, forces) = feet.run(round(1.2 * S))
    assert forces.state.tolist() == [State.VALID, State.DEGRADED, *[State.VALID] * 4]
    assert forces.cause[1] == Cause.ELEMENT_OPEN
    assert forces.force_n[:, 2] == pytest.approx([0.5] * 6, abs=0.05)
    strange = Scene(description="", load=load, faults=(StuckSda(at_s=1.0, leg="lm"),))
    with pytest.raises(ConfigError, match=r"scene: faults\[0\]: is for chips or wires of an I2C bus"):
        simulated_robot(MCU, strange)
