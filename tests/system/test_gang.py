"""A robot sets its feet down, byte for byte: ganged legs tell of it sooner, and a recording tells the same again."""

from pathlib import Path

import msgspec
import pytest

from footsense.config import DEFAULT, Config
from footsense.daemon.service import service
from footsense.frames import Cycle, Flag, Reading, State
from footsense.sim.scene import Effects, Scene, Tripod
from tests.system.command import footsense

TOUCH_S = 0.9
#: In the air long enough to learn what the columns read; then three feet touch down, the others do later.
SCENE = Scene(
    description="A robot sets three feet down.",
    load=Tripod(period_s=1.0, duty_rel=0.5, peak_force_n=1.0, pitch_deg=10),
    lead_in_s=TOUCH_S,
    host_cost_us=40,
    effects=Effects(converter_noise=True, converter_clock_rel=0.01, gap_contact=True),
)
FIRST, LATER = ("lf", "lr", "rm"), ("lm", "rf", "rr")


class Watch:
    """Keeps every cycle."""

    def __init__(self) -> None:
        self.cycles: list[Cycle] = []

    def observe(self, cycle: Cycle) -> None:
        self.cycles.append(cycle)

    def close(self) -> None:
        pass


def configured(*, gang: bool) -> Config:
    scan = msgspec.structs.replace(DEFAULT.scan, gang=gang)
    return msgspec.structs.replace(DEFAULT, publish="element", scan=scan)


def walk(record: Path, *, gang: bool) -> list[Cycle]:
    watch = Watch()
    with service(configured(gang=gang), SCENE, real_time=False, record=record) as running:
        running.observers.append(watch)
        running.run(lambda: running.scanning.clock.now_ns() > (TOUCH_S + 0.09) * 1e9)
    return watch.cycles


def told_s(cycles: list[Cycle], leg: str) -> float:
    """Return when contact of a leg is said first [s]."""
    row = DEFAULT.legs.index(leg)
    return next(c.forces.t_sent_ns * 1e-9 for c in cycles if c.forces.flags[row] & Flag.CONTACT)


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, tuple[Path, list[Cycle]]]:
    """Return recording and cycles of the same walk, ganged and not."""
    folder = tmp_path_factory.mktemp("gang")
    paths = {gang: folder / f"gang_{gang}.mcap" for gang in (True, False)}
    return {gang: (path, walk(path, gang=gang)) for gang, path in paths.items()}


def test_ganged_legs_tell_of_the_ground_as_soon_and_only_of_the_ground(
    walks: dict[bool, tuple[Path, list[Cycle]]],
) -> None:
    """No later than single elements by more than a conversion, and never before the touch; nobody else touches."""
    (_, ganged), (_, single) = walks[True], walks[False]
    for leg in FIRST:
        assert TOUCH_S < told_s(ganged, leg) < told_s(single, leg) + 0.003
    later = [DEFAULT.legs.index(leg) for leg in LATER]
    assert not any((cycle.forces.flags[later] & Flag.CONTACT).any() for cycle in ganged)
    assert not any((cycle.scan.reading == Reading.GANGED).any() for cycle in single)


def test_the_feet_on_the_ground_are_read_by_elements_again(
    walks: dict[bool, tuple[Path, list[Cycle]]],
) -> None:
    """In the end they are, and valid, while those in the air are still read by columns."""
    last = walks[True][1][-1]
    for leg in DEFAULT.legs:
        row = DEFAULT.legs.index(leg)
        assert last.forces.state[row] == State.VALID
        assert (last.scan.reading[row] == (Reading.OK if leg in FIRST else Reading.GANGED)).all()


def test_a_recording_of_ganged_legs_gives_the_same_forces(
    walks: dict[bool, tuple[Path, list[Cycle]]],
) -> None:
    """Column sums are recorded as they were read, so that the same code makes the same of them."""
    result = footsense("replay", walks[True][0], "--check")
    assert result.returncode == 0, result.stderr
