"""The cycles in shared memory: whole, newest first to go, and over restarts of the service."""

from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from footsense.errors import FootsenseError
from footsense.frames import ALL_LEGS, CanStatistics, CommandResult, Result, Vector
from footsense.recording.shared_cycles import N_SLOTS, CycleReader, SharedCycleWriter
from tests.support.cycles import LEGS, TARE, cycle, same


class Service:
    """A writer whose baselines can be moved."""

    def __init__(self, path: Path, legs: Sequence[str] = LEGS) -> None:
        self.baseline_pf: Vector = np.full((len(legs), 9), np.nan)
        self.can = CanStatistics()
        self.shared = SharedCycleWriter(path, legs, {"scene": "flat"}, lambda: self.baseline_pf, self.can)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "cycles"


@pytest.fixture
def service(path: Path) -> Iterator[Service]:
    service = Service(path)
    yield service
    service.shared.close()


def test_a_reader_gets_every_cycle_bit_for_bit(service: Service, path: Path) -> None:
    """With the header, the baselines of now, and the counts of CAN."""
    reader = CycleReader(path)
    assert (reader.header["scene"], reader.legs) == ("flat", LEGS)
    shown = [cycle(number, warm=True, n_samples=3) for number in range(40)]
    service.baseline_pf = np.arange(54.0).reshape(6, 9)
    service.can.sent = 7
    for one in shown:
        service.shared.observe(one)
    new = reader.read()
    assert new.n_missed == 0
    assert all(same(a, b.cycle) for a, b in zip(shown, new.cycles, strict=True))
    assert np.array_equal(reader.baseline_pf, service.baseline_pf)
    assert reader.can_statistics == service.can
    assert reader.read().cycles == []
    reader.close()


def test_eight_legs(path: Path) -> None:
    """The largest cycle fits its slot: gait, temperatures, and a long result for every leg."""
    service = Service(path, ALL_LEGS)
    reader = CycleReader(path)
    assert reader.legs == ALL_LEGS
    results = tuple(CommandResult(TARE._replace(leg=leg), Result.LOADED, "x" * 200) for leg in range(8))
    shown = [cycle(number, outcomes=results, n_legs=8, n_samples=3, warm=True) for number in range(4)]
    service.baseline_pf = np.arange(72.0).reshape(8, 9)
    for one in shown:
        service.shared.observe(one)
    new = reader.read()
    assert new.n_missed == 0
    assert all(same(a, b.cycle) for a, b in zip(shown, new.cycles, strict=True))
    assert np.array_equal(reader.baseline_pf, service.baseline_pf)
    reader.close()
    service.shared.close()


def test_a_slow_reader_gets_the_newest_and_counts_what_it_missed(service: Service, path: Path) -> None:
    """The writer never waits: it goes round the ring."""
    reader = CycleReader(path)
    one = cycle(0)
    for _ in range(3 * N_SLOTS):
        service.shared.observe(one)
    new = reader.read()
    assert [entry.cycle_number for entry in new.cycles] == list(range(2 * N_SLOTS + 1, 3 * N_SLOTS))
    assert new.n_missed == 2 * N_SLOTS + 1
    reader.close()


def test_a_burst_of_a_test_stand_does_not_hide_the_cycle(service: Service, path: Path) -> None:
    """The samples of the reference are left out if they do not fit the slot."""
    reader = CycleReader(path)
    service.shared.observe(cycle(0, n_samples=1000))
    (entry,) = reader.read().cycles
    assert same(entry.cycle, cycle(0, n_samples=1000)._replace(reference=None))
    reader.close()


def test_the_end_and_the_restart_of_a_service_are_noticed(path: Path) -> None:
    """A reader of the former service knows, and a new one reads the new service."""
    first = Service(path)
    reader = CycleReader(path)
    assert reader.is_still_written()
    with pytest.raises(FootsenseError, match="another running service writes this file"):
        Service(path)
    first.shared.close()
    assert not reader.is_still_written()
    with pytest.raises(FootsenseError, match="No such file"):
        CycleReader(path)
    second = Service(path)
    assert not reader.is_still_written()
    with closing(CycleReader(path)) as other:
        assert other.is_still_written()
    reader.close()
    second.shared.close()


@pytest.mark.parametrize("content", [b"", b"FSCYCLE1" + bytes(8), b"GARBAGE!" + b"\xff" * 64])
def test_other_files_are_one_line(path: Path, content: bytes) -> None:
    """A file without a writer, or of something else, is no service."""
    path.write_bytes(content)
    with pytest.raises(FootsenseError, match="its service has ended"):
        CycleReader(path)
