"""Board `ad7746` from end to end, byte for byte: it walks, tells its temperature, and says what is broken."""

from functools import partial
from typing import Any

import msgspec
import numpy as np
import pytest

from footsense.config import SMALL_BOARD
from footsense.frames import USABLE, Cause, Cycle, State, Vector
from footsense.sim.faults import scene_faults
from footsense.sim.faults.scene_faults import Fault
from footsense.sim.scene import Effects, Scene, Warming
from footsense.sim.scene_loads import Tripod, Unloaded
from tests.support.seen import walked as walk_and_see

ROBOT = msgspec.structs.replace(
    SMALL_BOARD,
    board="ad7746",
    buses=(msgspec.structs.replace(SMALL_BOARD.buses[0], legs={"lf": 0, "lm": 1, "rm": 4}),),
)
#: Slow steps on soft ground: a scan is a tenth of a second.
SLOW = Tripod(period_s=5.0, duty_rel=0.6, peak_force_n=0.4)
#: Conversions until all legs are tared.
TARED = 12 * 9
AT_2_S: dict[str, Any] = {"at_s": 2.0, "leg": "lm"}
REAL = Effects(converter_noise=True, converter_clock_rel=0.01)


walked = partial(walk_and_see, robot=ROBOT)


def test_it_walks() -> None:
    """Forces of all legs after the tare, no fault, 85 a second, and right to a few hundredths of a newton."""
    scene = Scene(description="A slow walk.", load=SLOW, host_cost_us=40, effects=REAL)
    errors_n: list[Vector] = []

    def felt(cycle: Cycle, true_n: Vector) -> None:
        errors_n.append((cycle.forces.force_n - true_n)[np.isin(cycle.forces.state, sorted(USABLE))])

    cycles = walked(scene, 9.0, felt)
    assert all((cycle.forces.state == State.VALID).all() for cycle in cycles[TARED:])
    assert np.sqrt(np.mean(np.concatenate(errors_n) ** 2)) < 0.03
    assert 84.5 < len(cycles) / 9.0 < 89.0


def test_each_converter_tells_its_temperature_every_ten_seconds() -> None:
    """To the 2 K of its data sheet, from the first scan on, and again when it has become warmer; scans go on."""
    warming = Warming(from_s=1.0, over_s=5.0, kelvin=10.0)
    effects = msgspec.structs.replace(REAL, warming=warming)
    cycles = walked(Scene(description="It gets warm.", load=Unloaded(), effects=effects), 11.0)
    first, last = (cycle.temperature_c for cycle in cycles if cycle.temperature_c is not None)
    assert (np.abs(first - 25.0) <= 2.0).all()
    assert len(set(first.tolist())) == 3
    np.testing.assert_allclose(last - first, 10.0, atol=1e-3)
    assert all((cycle.forces.state == State.VALID).all() for cycle in cycles[TARED:])
    assert max(np.diff([cycle.forces.t_sent_ns for cycle in cycles])) < 48_000_000


@pytest.mark.parametrize(
    ("fault", "state", "cause", "mask"),
    [
        (scene_faults.ElementOpen(element=4, **AT_2_S), State.DEGRADED, Cause.ELEMENT_OPEN, 0b000_010_000),
        (scene_faults.BrokenRow(row=0, **AT_2_S), State.DEGRADED, Cause.ROW_OPEN, 0b000_000_111),
        (scene_faults.BrokenColumn(column=2, **AT_2_S), State.DEGRADED, Cause.COLUMN_OPEN, 0b100_100_100),
        (scene_faults.ElementShorted(element=4, **AT_2_S), State.CONVERTER_FAULT, Cause.CANNOT_EXCITE, None),
        (scene_faults.StuckConverter(**AT_2_S), State.CONVERTER_FAULT, Cause.NEVER_FINISHES, None),
        (scene_faults.SwitchIgnoresWrites(**AT_2_S), State.CONVERTER_FAULT, Cause.SETTINGS_LOST, None),
        (scene_faults.Absent(**AT_2_S), State.ABSENT, Cause.NO_ANSWER, None),
        (scene_faults.WrongChip(**AT_2_S), State.ABSENT, Cause.WRONG_CHIP, None),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, msgspec.Struct) else "",
)
def test_what_breaks_has_its_own_words(fault: Fault, state: State, cause: Cause, mask: int | None) -> None:
    """The leg says what it is; no line that is open adds to another element; the other legs go on."""
    scene = Scene(description="Something breaks.", load=Unloaded(), effects=REAL, faults=(fault,))
    last = walked(scene, 4.0)[-1].forces
    assert (State(last.state[1]), Cause(last.cause[1])) == (state, cause)
    assert mask is None or last.fault_mask[1] == mask
    assert (last.state[[0, 2]] == State.VALID).all()
    if state is State.DEGRADED:
        assert np.abs(last.force_n[1]).max() < 0.02
