"""The recorder keeps all that it was shown, counts what it could not keep, and leaves no half-named file."""

import ctypes
import os
import signal
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from mcap.reader import make_reader

from footsense.errors import RecordingError
from footsense.recording.mcap_writer import McapFile
from footsense.recording.recorder import Recorder, check_recording_target, partial_path
from footsense.recording.replay import Replay
from footsense.recording.snapshot import write_snapshot
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.cycle_ring import CycleRing
from footsense.ring.records import LostCycles, NumberedCycle
from tests.support.cycles import LEGS, PERIOD_NS, cycle, quick_cycle, read_until_damage, same, status

#: See prctl(2).
PR_SET_CHILD_SUBREAPER = 36


@pytest.fixture
def ring(tmp_path: Path) -> Iterator[CycleRing]:
    """A ring without a name, as in virtual time."""
    with closing(CycleRing(None, LEGS, {"scene": "flat"}, 1.0, status)) as ring:
        yield ring


@pytest.mark.slow
def test_a_recording_is_whole_and_then_named(tmp_path: Path, ring: CycleRing) -> None:
    """FILE exists only when all cycles are in it; in virtual time there may be more of them than the ring holds."""
    path = tmp_path / "walk.mcap"
    recorder = Recorder(path, ring, waits=True)
    assert partial_path(path).exists()
    for number in range(1200):
        ring.observe(quick_cycle(number))
    recorder.close()
    recorder.close()
    assert [p.name for p in tmp_path.iterdir()] == ["walk.mcap"]
    assert recorder.n_lost_cycles == 0
    replay = Replay(path)
    assert (replay.header["scene"], replay.legs) == ("flat", LEGS)
    same_as_shown = [same(quick_cycle(number), one) for number, one in enumerate(replay)]
    assert same_as_shown == [True] * 1200


def test_a_recording_without_a_cycle_leaves_no_file(tmp_path: Path, ring: CycleRing) -> None:
    """As of a start that was refused or ended."""
    Recorder(tmp_path / "walk.mcap", ring, waits=True).close()
    assert list(tmp_path.iterdir()) == []


def test_a_killed_writer_s_cycles_are_counted(tmp_path: Path, ring: CycleRing) -> None:
    """Those that it had written are not among the missing."""
    path = tmp_path / "walk.mcap"
    recorder = Recorder(path, ring, waits=True)
    for number in range(300):
        ring.observe(quick_cycle(number))
    while recorder._last["n_cycles"] < 300:
        recorder._read_reports(blocking=True)
    os.kill(recorder._writer.pid, signal.SIGKILL)
    for number in range(300, 350):
        ring.observe(quick_cycle(number))
    with pytest.raises(RecordingError, match=r"was killed; 50 of 350 cycles are missing, the others are in"):
        recorder.close()
    assert len(read_until_damage(partial_path(path))[0]) == 300


def test_a_recording_of_hours_takes_no_more_memory(tmp_path: Path) -> None:
    """The index of its chunks is not kept in memory, and is in the file in the end."""
    path = tmp_path / "walk.mcap"
    with path.open("wb") as file:
        recording = McapFile(file.fileno(), {"legs": ",".join(LEGS)})

        def write(n_chunks: int) -> None:
            for _ in range(n_chunks):
                recording.add_entry(LostCycles(0, 0, 1))
                recording.flush()

        write(100)
        tracemalloc.start()
        write(2000)
        assert tracemalloc.get_traced_memory()[0] < 100_000
        tracemalloc.stop()
        recording.finish()
    with path.open("rb") as whole:
        summary = make_reader(whole).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) == 2100


def test_what_was_cut_short_is_not_overwritten(tmp_path: Path, ring: CycleRing) -> None:
    """An unfinished recording, too, is refused before the start."""
    (tmp_path / "cut.mcap.partial").touch()
    with pytest.raises(RecordingError, match="can be read as it is; rename or remove it"):
        Recorder(tmp_path / "cut.mcap", ring, waits=True)


def test_a_file_that_appears_during_the_recording_is_not_overwritten(tmp_path: Path, ring: CycleRing) -> None:
    """It stays as it is, the recording stays under its name in the making, and the end says why."""
    path = tmp_path / "walk.mcap"
    recorder = Recorder(path, ring, waits=True)
    ring.observe(cycle(0))
    path.write_text("somebody else's")
    with pytest.raises(RecordingError, match="it appeared in the meantime and is not overwritten"):
        recorder.close()
    assert path.read_text() == "somebody else's"
    assert len(list(Replay(partial_path(path)))) == 1


def test_a_recording_in_the_making_is_told_from_one_that_was_cut_short(
    tmp_path: Path, ring: CycleRing
) -> None:
    """A second recorder leaves it alone while its writer lives; at its end it is whole."""
    path = tmp_path / "walk.mcap"
    first = Recorder(path, ring, waits=True)
    ring.observe(cycle(0))
    with pytest.raises(RecordingError, match=r"partial: is being written by another footsense"):
        check_recording_target(path)
    first.close()
    assert len(list(Replay(path))) == 1


def test_a_recorder_that_hangs_loses_cycles_and_says_so(tmp_path: Path, ring: CycleRing) -> None:
    """In real time the loop does not wait: what is overwritten is counted, and recorded as lost."""
    path = tmp_path / "walk.mcap"
    recorder = Recorder(path, ring, waits=False)
    os.kill(recorder._writer.pid, signal.SIGSTOP)
    n = 1500
    for number in range(n):
        ring.observe(quick_cycle(number))
    assert recorder.n_lost_cycles == 0
    os.kill(recorder._writer.pid, signal.SIGCONT)
    while not (told := recorder.n_lost_cycles):
        pass
    recorder.close()
    lost = recorder.n_lost_cycles
    assert told == lost
    first, *entries = Replay(path).entries()
    assert first == LostCycles(lost, quick_cycle(lost).forces.t_sent_ns, lost)
    assert 200 < lost < n - 500
    assert [entry[0] for entry in entries] == list(range(lost, n))


def test_a_writer_never_counts_a_cycle_that_a_crash_would_lose(tmp_path: Path) -> None:
    """After each cycle: what is counted can be read back, and no more than one that can is not counted."""
    path = tmp_path / "walk.mcap.partial"
    seen = set()
    with path.open("wb") as file:
        recording = McapFile(file.fileno(), {"legs": ",".join(LEGS)})
        for number in range(150):
            recording.add_entry(NumberedCycle(number, quick_cycle(number)))
            if recording.n_cycles not in seen:
                seen.add(recording.n_cycles)
                read, _ = read_until_damage(path)
                assert recording.n_cycles <= len(read) <= recording.n_cycles + 1
        recording.finish()
    assert len(seen) > 2


@pytest.mark.slow
def test_a_snapshot_is_a_recording_of_what_the_ring_holds(tmp_path: Path) -> None:
    """Its cycles are counted from 0, and an existing file is refused."""
    path, target = tmp_path / "ring", tmp_path / "last.mcap"
    with (
        closing(CycleRing(path, LEGS, {"scene": "flat"}, 40.0, status)) as ring,
        closing(CycleReader(path)) as reader,
    ):
        with pytest.raises(RecordingError, match="no cycle yet"):
            write_snapshot(reader, target)
        for number in range(2000):
            ring.observe(quick_cycle(number))
        os.mkfifo(tmp_path / "last.mcap.unfinished")
        n = write_snapshot(reader, target)
        with pytest.raises(RecordingError, match="exists and is not overwritten"):
            write_snapshot(reader, target)
    replay = Replay(target)
    assert (replay.header["scene"], replay.header["snapshot_from_cycle"]) == ("flat", str(2000 - n))
    times_ns = [one.forces.t_sent_ns for one in replay]
    assert times_ns == [quick_cycle(number).forces.t_sent_ns for number in range(2000 - n, 2000)]
    assert n * PERIOD_NS > 30e9
    assert sorted(p.name for p in tmp_path.iterdir()) == ["last.mcap"]


@pytest.mark.slow
def test_a_killed_daemon_leaves_a_finished_recording(tmp_path: Path) -> None:
    """The end of the service ends the recording, so SIGKILL costs nothing that was observed."""
    path = tmp_path / "walk.mcap"
    # The orphaned writer becomes a child of this process, so that its end can be waited for.
    assert ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1) == 0
    daemon = subprocess.Popen(
        [sys.executable, "-c", RECORD_AND_DIE, str(path), str(Path(__file__).parents[3])],
        stdout=subprocess.PIPE,
        text=True,
    )
    writer_pid = int(daemon.communicate()[0])
    assert daemon.returncode == -signal.SIGKILL
    os.waitpid(writer_pid, 0)
    assert path.exists()
    assert all(same(one, cycle(number)) for number, one in enumerate(Replay(path)))
    assert len(list(Replay(path))) == 300


#: A daemon that observes 300 cycles and is killed; argv: the file, the top of the checkout.
RECORD_AND_DIE = """
import os, pathlib, signal, sys
sys.path.insert(0, sys.argv[2])
from tests.support.cycles import LEGS, cycle, status
from footsense.recording.recorder import Recorder
from footsense.ring.cycle_ring import CycleRing
ring = CycleRing(None, LEGS, {}, 40.0, status)
recorder = Recorder(pathlib.Path(sys.argv[1]), ring, waits=True)
for number in range(300):
    ring.observe(cycle(number))
print(recorder._writer.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
