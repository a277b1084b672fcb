"""Recordings of faults: which are due, what is kept of them, and that a full disk costs the file alone."""

from collections.abc import Iterator
from contextlib import closing
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from footsense.cli.info import info
from footsense.frames import Cause, Cycle
from footsense.recording.fault_recordings import MOST, MOST_ALIKE, FaultRecorder
from footsense.recording.replay import Replay
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.cycle_ring import CycleRing
from tests.support.cycles import LEGS, cycle, status

S = 1_000_000_000


def faulty(number: int, t_s: float, *causes: Cause) -> Cycle:
    """Return a cycle at a time, whose first legs have causes."""
    one = cycle(number)
    all_causes = np.zeros(len(LEGS), np.uint8)
    all_causes[: len(causes)] = causes
    return one._replace(forces=one.forces._replace(t_sent_ns=int(t_s * S), cause=all_causes))


@pytest.fixture
def ring(tmp_path: Path) -> Iterator[CycleRing]:
    with closing(CycleRing(tmp_path / "ring", LEGS, {"scene": "flat"}, 40.0, status)) as ring:
        yield ring


def test_a_recording_is_due_ten_seconds_after_a_new_cause_and_at_most_one_a_minute(
    tmp_path: Path, ring: CycleRing
) -> None:
    """What is not due at the end is written then, once."""
    folder, now_s = tmp_path / "faults", 0.0
    with closing(CycleReader(tmp_path / "ring")) as reader:
        recorder = FaultRecorder(reader, folder, lambda: f"{now_s:05.1f}Z")
        for number, now_s in enumerate(np.arange(0.0, 180.0, 0.5).tolist()):
            first = Cause.ELEMENT_STUCK if now_s >= 20.0 else Cause.NONE
            second = Cause.OVERLOAD if now_s % 10.0 < 5.0 else Cause.NONE  # flaps
            seen = faulty(number, now_s, first, second)
            ring.observe(seen)
            recorder.add([seen])
        now_s = 300.0
        recorder.add([faulty(0, now_s, Cause.COLUMN_OPEN)])
        left, right = LEGS[:2]
        names = [f"{due_s}Z-{right}-overload.mcap" for due_s in ("010.0", "070.0", "130.0")]
        assert sorted(path.name for path in folder.iterdir()) == names
        recorder.end()
        now_s = 301.0
        recorder.end()
    names.append(f"300.0Z-{left}-column-open.mcap")
    assert sorted(path.name for path in folder.iterdir()) == names


def test_the_newest_are_kept_and_listed(tmp_path: Path, ring: CycleRing) -> None:
    """Of one leg and cause three, in all twenty; each has what the ring held."""
    folder, minutes = tmp_path / "faults", count()
    numbers = count()

    def wall_time() -> str:
        return f"2026-11-29T12:{next(minutes):02d}:00Z"

    with closing(CycleReader(tmp_path / "ring")) as reader:
        recorder = FaultRecorder(reader, folder, wall_time)
        causes = [cause for cause in Cause if cause is not Cause.NONE]
        for k, cause in enumerate([causes[0]] * 5 + causes * 2):
            seen = [faulty(next(numbers), 100.0 * k + t_s, *given) for t_s, given in ((0, ()), (1, (cause,)))]
            for one in seen:
                ring.observe(one)
            recorder.add(seen)
            if k % 2:
                recorder.add([faulty(next(numbers), 100.0 * k + 20, cause)])
            else:
                recorder.end()  # the service ends before it is due
    kept = sorted(path.name for path in folder.iterdir())
    assert len(kept) == min(MOST, MOST_ALIKE + 2 * (len(causes) - 1))
    assert (
        sum(name.endswith(f"{causes[0].name.lower().replace('_', '-')}.mcap") for name in kept) <= MOST_ALIKE
    )
    assert Replay(folder / kept[-1]).header["scene"] == "flat"
    listed = CliRunner().invoke(info, [str(folder)]).output.splitlines()
    assert [line.split()[0] for line in listed] == [str(folder / name) for name in reversed(kept)]


def test_a_disk_that_is_full_costs_the_file_alone(
    tmp_path: Path, ring: CycleRing, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "faults"
    folder.write_text("in the way")
    one = faulty(0, 1.0, Cause.NO_ANSWER)
    ring.observe(one)
    with closing(CycleReader(tmp_path / "ring")) as reader:
        recorder = FaultRecorder(reader, folder, lambda: "2026-11-29T12:00:00Z")
        recorder.add([one])
        recorder.end()
    assert f"{LEGS[0]}-no-answer is not recorded" in caplog.text
