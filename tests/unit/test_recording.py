"""A recording gives back every bit that it was given, or says what it cannot give."""

import ctypes
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from numpy.typing import NDArray

from footsense.errors import ConfigError, RecordingError
from footsense.frames import (
    CapFrame,
    Command,
    CommandKind,
    Cycle,
    Flag,
    ForceFrame,
    Outcome,
    Reading,
    Result,
    State,
)
from footsense.recording.compare import compare, same_machine
from footsense.recording.cycle_pipe import CyclePipe
from footsense.recording.machine import this_machine
from footsense.recording.mcap_writer import McapFile
from footsense.recording.pipe_format import CyclePacker, Loss, Numbered, pack_header, pack_loss, unpack
from footsense.recording.recorder import Recorder, check_target, partial_path
from footsense.recording.recover import recover
from footsense.recording.replay import Replay, ReplayClock, ReplaySource
from footsense.recording.writer import FdStream, PipeWriter

LEGS = ("lf", "lm", "lr", "rf", "rm", "rr")
#: See prctl(2).
PR_SET_CHILD_SUBREAPER = 36

PERIOD_NS = 25_000_000
TARE = Command(CommandKind.TARE, 2)
AWKWARD = np.array([np.nan, np.inf, -np.inf, -0.0, 5e-324, 0.1, 1.7976931348623157e308, 1 / 3])


def cycle(number: int, seed: int = 0, *, outcomes: tuple[Outcome, ...] = (), n_legs: int = 6) -> Cycle:
    """Return a cycle of random bits, awkward floats among them."""
    rng = np.random.default_rng([seed, number])

    def floats(*shape: int) -> NDArray[np.float64]:
        values = rng.integers(0, 2**64, shape, dtype=np.uint64).view(np.float64)
        return np.where(rng.random(shape) < 0.2, rng.choice(AWKWARD, shape), values)

    scan = CapFrame(
        number,
        rng.integers(0, 2**63, (n_legs, 9)),
        floats(n_legs, 9),
        rng.choice([int(r) for r in Reading], (n_legs, 9)).astype(np.uint8),
    )
    forces = ForceFrame(
        number,
        1_000 + number * PERIOD_NS,
        rng.integers(0, 2**63, n_legs),
        floats(n_legs, 3),
        floats(n_legs, 3),
        rng.choice([int(s) for s in State], n_legs).astype(np.uint8),
        rng.integers(0, 512, n_legs).astype(np.uint16),
        rng.choice([int(f) for f in Flag], n_legs).astype(np.uint8),
    )
    commands = (TARE,) if number % 7 == 3 else ()
    return Cycle(scan, commands, forces, outcomes)


def same(a: Cycle, b: Cycle) -> bool:
    """Return whether two cycles are equal bit for bit, NaN equal to NaN."""
    arrays = ("t_ns", "capacitance_pf", "reading")
    scans = all(np.array_equal(getattr(a.scan, f), getattr(b.scan, f), equal_nan=True) for f in arrays)
    zeros = np.array_equal(np.signbit(a.scan.capacitance_pf), np.signbit(b.scan.capacitance_pf))
    legs = LEGS[: len(a.forces.state)]
    return (
        scans
        and (zeros or bool(np.isnan(a.scan.capacitance_pf).any()))
        and a.scan.sequence == b.scan.sequence
        and compare(a.forces, b.forces, exact=True, legs=legs) is None
        and (a.commands, a.outcomes) == (b.commands, b.outcomes)
    )


def write(path: Path, cycles: list[Cycle], every: int = 20) -> Path:
    """Write a finished recording in this process, a chunk for every so many cycles."""
    with path.open("wb") as file:
        recording = McapFile(FdStream(file.fileno()), {"legs": ",".join(LEGS), "scene": "test"})
        for number, one in enumerate(cycles):
            recording.add_cycle(Numbered(number, one))
            if number % every == every - 1:
                recording.flush()
        recording.finish()
    return path


def read_until_damage(path: Path) -> tuple[list[Cycle], RecordingError | None]:
    cycles: list[Cycle] = []
    try:
        cycles.extend(Replay(path))
    except RecordingError as error:
        return cycles, error
    return cycles, None


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[Cycle]]:
    """Return the bytes of a recording of 60 cycles in three chunks, and the cycles."""
    cycles = [cycle(number) for number in range(60)]
    return write(tmp_path_factory.mktemp("walk") / "walk.mcap", cycles).read_bytes(), cycles


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scratch") / "damaged.mcap"


outcome = st.builds(Outcome, st.just(TARE), st.sampled_from(Result), st.text(max_size=40))


@given(st.integers(0, 2**32), st.integers(1, 6), st.lists(outcome, max_size=3), st.integers(1, 4000))
def test_the_pipe_keeps_every_bit(seed: int, n_legs: int, outcomes: list[Outcome], piece: int) -> None:
    """Cycles come out of the pipe as they went in, in whatever pieces they arrive."""
    packer = CyclePacker(n_legs)
    shown = [cycle(number, seed, outcomes=tuple(outcomes), n_legs=n_legs) for number in range(3)]
    header = {"legs": ",".join(LEGS[:n_legs])}
    stream = pack_header(header) + b"".join(bytes(packer.pack(i, one)) for i, one in enumerate(shown))
    stream += pack_loss(Loss(9, 8, 6))
    buffer, entries, legs = bytearray(), [], None
    for at in range(0, len(stream), piece):
        buffer += stream[at : at + piece]
        for entry in unpack(buffer, legs):
            legs = n_legs
            entries.append(entry)
    assert entries[0] == header
    assert entries[-1] == Loss(9, 8, 6)
    numbered = [entry for entry in entries if isinstance(entry, Numbered)]
    assert [entry.counter for entry in numbered] == [0, 1, 2]
    assert all(same(a, b.cycle) for a, b in zip(shown, numbered, strict=True))


@given(st.integers(0, 2**32), st.lists(outcome, max_size=2))
@settings(max_examples=25)
def test_the_file_keeps_every_bit(scratch: Path, seed: int, outcomes: list[Outcome]) -> None:
    """Floats of any value, NaN, infinities and -0.0, and reasons in any script come out of the file again."""
    shown = [cycle(number, seed, outcomes=tuple(outcomes)) for number in range(5)]
    read, damage = read_until_damage(write(scratch, shown))
    assert damage is None
    assert all(same(a, b) for a, b in zip(shown, read, strict=True))


@given(st.data())
def test_a_truncated_file_gives_what_is_whole(
    scratch: Path, walk: tuple[bytes, list[Cycle]], data: st.DataObject
) -> None:
    """Wherever a file ends, the cycles before are right and the error says that the rest is lost."""
    whole, cycles = walk
    scratch.write_bytes(whole[: data.draw(st.integers(0, len(whole) - 1))])
    read, damage = read_until_damage(scratch)
    assert all(same(a, b) for a, b in zip(cycles, read, strict=False))
    assert damage is not None or len(read) == len(cycles)
    assert "\n" not in str(damage)


@given(st.data())
def test_a_flipped_bit_is_never_taken_for_a_measurement(
    scratch: Path, walk: tuple[bytes, list[Cycle]], data: st.DataObject
) -> None:
    """One wrong bit ends the reading with an error, or stands in the index, which is not read."""
    whole, cycles = walk
    damaged = bytearray(whole)
    damaged[data.draw(st.integers(0, len(whole) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    scratch.write_bytes(damaged)
    read, damage = read_until_damage(scratch)
    assert all(same(a, b) for a, b in zip(cycles, read, strict=False))
    assert damage is not None or len(read) == len(cycles)


def test_a_truncated_file_says_what_is_lost(scratch: Path, walk: tuple[bytes, list[Cycle]]) -> None:
    """The error names the byte, the number of whole cycles and their last time."""
    whole, _ = walk
    scratch.write_bytes(whole[: len(whole) // 2])
    read, damage = read_until_damage(scratch)
    assert len(read) == 20
    assert f"of {len(whole) // 2} (" in str(damage)
    assert "20 cycles are whole, up to 0.475 s after the first; what follows is lost" in str(damage)


@pytest.mark.parametrize("content", [b"", b"not a recording", b"\x89MCAP0\r\n"])
def test_another_file_is_not_a_recording(scratch: Path, content: bytes) -> None:
    """Whatever is not ours is refused in one line."""
    scratch.write_bytes(content)
    with pytest.raises(RecordingError, match="is not a recording"):
        Replay(scratch)


def test_recover_makes_a_sound_file(tmp_path: Path, walk: tuple[bytes, list[Cycle]]) -> None:
    """What is whole in a cut file is in the new one, which the indexed readers of other tools can open."""
    whole, cycles = walk
    cut = tmp_path / "walk.mcap.partial"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    recovered = recover(cut, tmp_path / "walk.mcap")
    read, damage = read_until_damage(tmp_path / "walk.mcap")
    assert damage is None
    assert recovered.damage is not None
    assert recovered.n_cycles == len(read) > 0
    assert all(same(a, b) for a, b in zip(cycles, read, strict=False))
    with (tmp_path / "walk.mcap").open("rb") as file:
        topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
    assert topics.count("/scan") == topics.count("/force") == len(read)


def test_replay_gives_scan_commands_and_time(walk: tuple[bytes, list[Cycle]], scratch: Path) -> None:
    """The source and its clock show the loop what it saw when it was recorded."""
    whole, cycles = walk
    scratch.write_bytes(whole)
    source = ReplaySource(Replay(scratch))
    clock = ReplayClock(source)
    for then in cycles:
        scan = source.read()
        assert scan is not None
        assert scan.sequence == then.scan.sequence
        assert tuple(source.commands()) == then.commands
        assert source.commands() == []
        assert clock.now_ns() == then.forces.t_sent_ns
    assert source.read() is None
    assert source.damage is None


def test_replay_counts_what_was_lost(scratch: Path) -> None:
    """The source gives the scans on both sides of a gap, and tells the gap with the scan after it."""
    with scratch.open("wb") as file:
        recording = McapFile(FdStream(file.fileno()), {"legs": ",".join(LEGS)})
        recording.add_cycle(Numbered(0, cycle(0)))
        recording.add_loss(Loss(4, 0, 3))
        recording.add_cycle(Numbered(4, cycle(4)))
        recording.finish()
    source = ReplaySource(Replay(scratch))
    seen = [(scan.sequence, source.lost) for scan in iter(source.read, None)]
    assert seen == [(0, 0), (4, 3)]


def test_compare_names_the_first_difference() -> None:
    """The difference is told with its leg, field and both values; 1 mN is none on another machine."""
    then, now = cycle(0).forces, cycle(0).forces
    then.force_n[3], now.force_n[3] = (0.1, 0.2, np.nan), (0.1, 0.2 + 5e-4, np.nan)
    found = compare(then, now, exact=True, legs=LEGS)
    assert found == "scan 0, sent at 0.000 s, leg rf: fy_n was 0.2, is now 0.2005"
    now.force_n[:], now.sigma_n[:] = then.force_n, then.sigma_n
    now.force_n[3, 1] += 5e-4
    assert compare(then, now, exact=False, legs=LEGS) is None
    now.state[1] = (then.state[1] + 1) % 10
    assert "leg lm: state was" in str(compare(then, now, exact=False, legs=LEGS))


def test_the_same_machine_has_the_same_processor_and_libraries() -> None:
    """Bits are compared only where the header names this processor and these versions."""
    here = this_machine()
    assert same_machine({**here, "scene": "x"}, here)
    assert not same_machine({**here, "numpy": "0"}, here)
    assert not same_machine({}, here)


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
    assert recorder.lost == 0
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


@pytest.mark.parametrize("name", ["walk.txt", "-", "walk", "walk.mcap.partial"])
def test_a_recording_ends_in_mcap(tmp_path: Path, name: str) -> None:
    """Another suffix is a mistake, `-` among them; no file is made."""
    with pytest.raises(ConfigError, match=rf"{name}: the name has to end in \.mcap"):
        check_target(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_recording_in_the_making_is_told_from_one_that_was_cut_short(tmp_path: Path) -> None:
    """A second recorder and `recover` leave it alone while its writer lives; at its end it is whole."""
    path = tmp_path / "walk.mcap"
    first = Recorder(path, LEGS, {}, blocking=True)
    first.observe(cycle(0))
    for attempt in (lambda: check_target(path), lambda: recover(partial_path(path), path)):
        with pytest.raises(RecordingError, match=r"partial: is being written by another footsense"):
            attempt()
    first.close()
    assert len(list(Replay(path))) == 1


def test_a_full_pipe_loses_cycles_and_says_so(tmp_path: Path) -> None:
    """In real time a cycle that finds no room is counted, and recorded as lost before the next one."""
    read_end, write_end = os.pipe()
    pipe = CyclePipe(write_end, LEGS, {}, blocking=False)
    for number in range(100):
        pipe.send(cycle(number))
    lost = pipe.lost
    assert 0 < lost < 100
    with (tmp_path / "walk.mcap").open("wb") as file:
        writer = PipeWriter(file.fileno())
        writer.feed(os.read(read_end, 1 << 20))
        pipe.send(cycle(100))
        pipe.close(0.0)
        writer.feed(os.read(read_end, 1 << 20))
        writer.finish()
    os.close(read_end)
    entries = list(Replay(tmp_path / "walk.mcap").entries())
    assert entries[-2] == Loss(100, 1_000 + 100 * PERIOD_NS, lost)
    numbered = [entry for entry in entries if isinstance(entry, Numbered)]
    assert [entry.counter for entry in numbered] == [*range(100 - lost), 100]
    assert all(same(entry.cycle, cycle(entry.counter)) for entry in numbered)


@pytest.mark.parametrize("blocking", [True, False])
def test_a_writer_that_hangs_does_not_hold_up_the_end(blocking: bool) -> None:  # noqa: FBT001 - a case
    """With the pipe full and nobody reading, closing gives up after its timeout, here at once."""
    read_end, write_end = os.pipe()
    pipe = CyclePipe(write_end, LEGS, {}, blocking=False)
    for number in range(100):
        pipe.send(cycle(number))
    os.set_blocking(write_end, blocking)
    pipe.close(0.0)
    os.close(read_end)


def test_a_full_disk_does_not_stop_the_loop(tmp_path: Path) -> None:
    """A writer that cannot write leaves the loop running, and the loss is told at the end."""
    limit = f"import resource as r; r.setrlimit(r.RLIMIT_FSIZE, (20000, 20000))\n{RECORD_AND_END}"
    done = subprocess.run(
        [sys.executable, "-c", limit, str(tmp_path / "walk.mcap"), str(Path(__file__).parent)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "File too large" in done.stdout, done
    assert "of 300 cycles are missing, the others are in walk.mcap.partial" in done.stdout
    read, damage = read_until_damage(tmp_path / "walk.mcap.partial")
    assert damage is not None
    assert all(same(one, cycle(number)) for number, one in enumerate(read))


def test_a_killed_daemon_leaves_a_finished_recording(tmp_path: Path) -> None:
    """The end of the pipe ends the recording, so SIGKILL costs nothing that was observed."""
    path = tmp_path / "walk.mcap"
    # The orphaned writer becomes a child of this process, so that its end can be waited for.
    assert ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1) == 0
    daemon = subprocess.Popen(
        [sys.executable, "-c", RECORD_AND_DIE, str(path), str(Path(__file__).parent)],
        stdout=subprocess.PIPE,
        text=True,
    )
    writer_pid = int(daemon.communicate()[0])
    assert daemon.returncode == -signal.SIGKILL
    os.waitpid(writer_pid, 0)
    assert path.exists()
    assert all(same(one, cycle(number)) for number, one in enumerate(Replay(path)))
    assert len(list(Replay(path))) == 300


#: A daemon that observes 300 cycles; argv: the file, the directory of this test.
RECORD = """
import os, pathlib, signal, sys
sys.path.insert(0, sys.argv[2])
from test_recording import LEGS, cycle
from footsense.errors import RecordingError
from footsense.recording.recorder import Recorder
recorder = Recorder(pathlib.Path(sys.argv[1]), LEGS, {}, blocking=True)
for number in range(300):
    recorder.observe(cycle(number))
"""
RECORD_AND_END = f"""{RECORD}
try:
    recorder.close()
except RecordingError as error:
    print(error)
"""
RECORD_AND_DIE = f"""{RECORD}
print(recorder._writer.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
