"""The recorder keeps all that it was shown, counts what it could not keep, and leaves no half-named file."""

import ctypes
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from footsense.errors import ConfigError, RecordingError
from footsense.recording.cycle_pipe import CyclePipe
from footsense.recording.cycle_records import LostCycles, NumberedCycle
from footsense.recording.recorder import Recorder, check_recording_target, partial_path
from footsense.recording.recover import recover
from footsense.recording.replay import Replay
from footsense.recording.writer import RecordingWriter
from tests.support.cycles import LEGS, PERIOD_NS, cycle, read_until_damage, same

#: See prctl(2).
PR_SET_CHILD_SUBREAPER = 36


def test_a_recording_is_whole_and_then_named(tmp_path: Path) -> None:
    """The recorder's process writes all cycles, and FILE exists only when they are in it."""
    path = tmp_path / "walk.mcap"
    recorder = Recorder(path, LEGS, {"scene": "flat"}, blocking=True)
    assert partial_path(path).exists()
    shown = [cycle(number) for number in range(100)]
    for one in shown:
        recorder.observe(one)
    recorder.close()
    recorder.close()
    assert [p.name for p in tmp_path.iterdir()] == ["walk.mcap"]
    assert recorder.n_lost_cycles == 0
    replay = Replay(path)
    assert (replay.header["scene"], replay.legs) == ("flat", LEGS)
    assert all(same(a, b) for a, b in zip(shown, replay, strict=True))


def test_an_existing_file_is_not_overwritten(tmp_path: Path) -> None:
    """A finished recording, an unfinished one, and a missing directory are refused before the start."""
    (tmp_path / "walk.mcap").touch()
    (tmp_path / "cut.mcap.partial").touch()
    for name, wanted in (
        ("walk.mcap", "exists and is not overwritten"),
        ("cut.mcap", "footsense recover it, or remove it"),
        ("none/walk.mcap", "there is no directory"),
    ):
        with pytest.raises(RecordingError, match=wanted):
            Recorder(tmp_path / name, LEGS, {}, blocking=True)


def test_a_file_that_appears_during_the_recording_is_not_overwritten(tmp_path: Path) -> None:
    """It stays as it is, the recording stays under its name in the making, and the end says why."""
    path = tmp_path / "walk.mcap"
    recorder = Recorder(path, LEGS, {}, blocking=True)
    recorder.observe(cycle(0))
    path.write_text("somebody else's")
    with pytest.raises(RecordingError, match="it appeared in the meantime and is not overwritten"):
        recorder.close()
    assert path.read_text() == "somebody else's"
    assert len(list(Replay(partial_path(path)))) == 1


@pytest.mark.parametrize("name", ["walk.txt", "-", "walk", "walk.mcap.partial"])
def test_a_recording_ends_in_mcap(tmp_path: Path, name: str) -> None:
    """Another suffix is a mistake, `-` among them; no file is made."""
    with pytest.raises(ConfigError, match=rf"{name}: the name has to end in \.mcap"):
        check_recording_target(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_recording_in_the_making_is_told_from_one_that_was_cut_short(tmp_path: Path) -> None:
    """A second recorder and `recover` leave it alone while its writer lives; at its end it is whole."""
    path = tmp_path / "walk.mcap"
    first = Recorder(path, LEGS, {}, blocking=True)
    first.observe(cycle(0))
    for attempt in (lambda: check_recording_target(path), lambda: recover(partial_path(path), path)):
        with pytest.raises(RecordingError, match=r"partial: is being written by another footsense"):
            attempt()
    first.close()
    assert len(list(Replay(path))) == 1


def test_a_full_pipe_loses_cycles_and_says_so(tmp_path: Path) -> None:
    """In real time a cycle that finds no room is counted, and recorded as lost before the next one."""
    read_end, write_end = os.pipe()
    pipe = CyclePipe(write_end, {"legs": ",".join(LEGS)}, blocking=False)
    for number in range(100):
        pipe.send(cycle(number))
    lost = pipe.lost
    assert 0 < lost < 100
    with (tmp_path / "walk.mcap").open("wb") as file:
        writer = RecordingWriter(file.fileno())
        writer.feed(os.read(read_end, 1 << 20))
        pipe.send(cycle(100))
        pipe.close(0.0)
        writer.feed(os.read(read_end, 1 << 20))
        writer.finish()
    os.close(read_end)
    entries = list(Replay(tmp_path / "walk.mcap").entries())
    assert entries[-2] == LostCycles(100, 1_000 + 100 * PERIOD_NS, lost)
    numbered = [entry for entry in entries if isinstance(entry, NumberedCycle)]
    assert [entry.cycle_number for entry in numbered] == [*range(100 - lost), 100]
    assert all(same(entry.cycle, cycle(entry.cycle_number)) for entry in numbered)


def test_a_writer_never_counts_a_cycle_that_a_crash_would_lose(tmp_path: Path) -> None:
    """After each cycle: what is counted can be read back, and no more than one that can is not counted."""
    read_end, write_end = os.pipe()
    pipe = CyclePipe(write_end, {"legs": ",".join(LEGS)}, blocking=False)
    path = tmp_path / "walk.mcap.partial"
    seen = set()
    with path.open("wb") as file:
        writer = RecordingWriter(file.fileno())
        for number in range(500):
            one = cycle(number)
            pipe.send(one._replace(forces=one.forces._replace(t_sent_ns=1_000 + number)))
            writer.feed(os.read(read_end, 1 << 20))
            if writer.n_cycles not in seen:
                seen.add(writer.n_cycles)
                read, _ = read_until_damage(path)
                assert writer.n_cycles <= len(read) <= writer.n_cycles + 1
    pipe.close(0.0)
    os.close(read_end)
    assert len(seen) > 2


@pytest.mark.parametrize("blocking", [True, False])
def test_a_writer_that_hangs_does_not_hold_up_the_end(blocking: bool) -> None:  # noqa: FBT001 - a case
    """With the pipe full and nobody reading, closing gives up after its timeout, here at once."""
    read_end, write_end = os.pipe()
    pipe = CyclePipe(write_end, {"legs": ",".join(LEGS)}, blocking=False)
    for number in range(100):
        pipe.send(cycle(number))
    os.set_blocking(write_end, blocking)
    pipe.close(0.0)
    os.close(read_end)


def test_a_full_disk_does_not_stop_the_loop(tmp_path: Path) -> None:
    """A writer that cannot write leaves the loop running; it is said once, and at the end what is missing."""
    limit = f"import resource as r; r.setrlimit(r.RLIMIT_FSIZE, (60000, 60000))\n{RECORD_ON_A_FULL_DISK}"
    done = subprocess.run(
        [sys.executable, "-c", limit, str(tmp_path / "walk.mcap"), str(Path(__file__).parents[3])],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == f"{tmp_path}/walk.mcap: File too large; the run goes on without its recording\n"
    read, damage = read_until_damage(tmp_path / "walk.mcap.partial")
    assert damage is not None
    assert all(same(one, cycle(number)) for number, one in enumerate(read))
    said = re.search(
        r"File too large; (\d+) of (\d+) cycles are missing, the others are in walk", done.stdout
    )
    assert said is not None, done
    missing, observed = map(int, said.groups())
    assert 0 < len(read) <= 300 < observed
    assert observed - missing <= len(read) <= observed - missing + 1


def test_a_killed_daemon_leaves_a_finished_recording(tmp_path: Path) -> None:
    """The end of the pipe ends the recording, so SIGKILL costs nothing that was observed."""
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


#: A daemon that observes 300 cycles; argv: the file, the top of the checkout.
RECORD = """
import os, pathlib, signal, sys
sys.path.insert(0, sys.argv[2])
from tests.support.cycles import LEGS, cycle
from footsense.errors import RecordingError
from footsense.recording.recorder import Recorder
recorder = Recorder(pathlib.Path(sys.argv[1]), LEGS, {}, blocking=True)
for number in range(300):
    recorder.observe(cycle(number))
"""
RECORD_ON_A_FULL_DISK = f"""{RECORD}
while not recorder._pipe.broken:
    recorder.observe(cycle(300))
try:
    recorder.close()
except RecordingError as error:
    print(error)
"""
RECORD_AND_DIE = f"""{RECORD}
print(recorder._writer.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
