"""The ring: every cycle bit for bit or counted as missed, over ends and restarts; nothing else has its name."""

import contextlib
import errno
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.errors import FootsenseError
from footsense.frames import ALL_LEGS, CanStatistics, CommandResult, Result
from footsense.ring import ring_file
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.cycle_ring import CycleRing, encode_cycle
from footsense.ring.records import LostCycles, NumberedCycle, ServiceStatus, decode_record
from footsense.ring.ring_file import free_ring
from tests.support.cycles import LEGS, PERIOD_NS, TARE, cycle, quick_cycle, same, status

outcomes = st.lists(
    st.builds(CommandResult, st.just(TARE), st.sampled_from(Result), st.text(max_size=40)), max_size=3
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "ring"


@pytest.fixture
def ring(path: Path) -> Iterator[CycleRing]:
    with closing(CycleRing(path, LEGS, {"scene": "flat"}, 40.0, status)) as ring:
        yield ring


@given(st.integers(0, 2**32), st.integers(3, 8), outcomes, st.none() | st.integers(0, 6))
def test_a_record_keeps_every_bit(
    seed: int, n_legs: int, results: list[CommandResult], n_samples: int | None
) -> None:
    for number in range(3):
        shown = cycle(
            number, seed, outcomes=tuple(results), n_legs=n_legs, n_samples=n_samples, warm=number > 0
        )
        entry = decode_record(encode_cycle(number, shown), n_legs)
        assert isinstance(entry, NumberedCycle)
        assert entry.cycle_number == number
        assert same(entry.cycle, shown)


def test_integers_of_numpy_are_written_as_numbers() -> None:
    """A leg found with numpy, in a command or its result, does not end the loop."""
    tare = TARE._replace(leg=np.int64(2))  # type: ignore[arg-type]
    shown = cycle(3, outcomes=(CommandResult(tare, Result.DONE, "0.1 pF"),))
    entry = decode_record(encode_cycle(0, shown._replace(started_commands=(tare,))), len(LEGS))
    assert isinstance(entry, NumberedCycle)
    assert entry.cycle.started_commands == (TARE,)
    assert entry.cycle.ended_commands == (CommandResult(TARE, Result.DONE, "0.1 pF"),)


def test_a_reader_gets_every_cycle_and_the_status(path: Path) -> None:
    """With the header; the status is that of a tenth of a second ago at most."""
    now = ServiceStatus(CanStatistics(sent=7), np.arange(72.0).tobytes(), [1.0, 2.0], 3, 4, 5, 6)
    with closing(CycleRing(path, ALL_LEGS, {"scene": "flat"}, 40.0, lambda: now)) as ring:
        reader = CycleReader(path)
        assert (reader.header["scene"], reader.legs, reader.status) == ("flat", ALL_LEGS, None)
        shown = [cycle(number, n_legs=8, warm=True, n_samples=3) for number in range(40)]
        for one in shown:
            ring.observe(one)
        read = reader.read()
        assert [entry[0] for entry in read] == list(range(40))
        assert all(same(a, b[1]) for a, b in zip(shown, read, strict=True) if isinstance(b, NumberedCycle))
        assert reader.status == now
        assert np.array_equal(reader.status.baseline_pf, np.arange(72.0).reshape(8, 9))
        assert (reader.read(), reader.position) == ([], reader.end)
        reader.close()


def test_a_slow_reader_counts_what_it_missed(ring: CycleRing, path: Path) -> None:
    """The writer never waits; after a gap a reader begins with a status, and one that comes late with the newest."""
    with closing(CycleReader(path)) as reader:
        ring.observe(cycle(0))
        assert len(reader.read()) == 1
        n = 0
        while reader.end - reader.position < 3 << 21:
            n += 1
            ring.observe(quick_cycle(n))
        read: list[NumberedCycle | LostCycles] = []
        while entries := reader.read():
            read += entries
        loss = read[0]
        assert isinstance(loss, LostCycles)
        assert loss == LostCycles(1 + loss.n_cycles, 1_000 + read[1][0] * PERIOD_NS, loss.n_cycles)
        assert [entry[0] for entry in read[1:]] == list(range(1 + loss.n_cycles, n + 1))
        assert n - loss.n_cycles > 1000
    with closing(CycleReader(path)) as late:
        numbers = [entry[0] for entry in late.read()]
        assert n - 50 <= numbers[0] < numbers[-1] == n
        late.rewind(first_number=0)
        assert late.read()[0][0] == 1 + loss.n_cycles


def test_a_writer_that_waits_loses_nothing(ring: CycleRing, path: Path) -> None:
    """Before a byte is overwritten, the position behind it is told."""
    with closing(CycleReader(path)) as reader:
        numbers: list[int] = []

        def read_until(position: int) -> None:
            while reader.position < position:
                numbers.extend(entry[0] for entry in reader.read())

        ring.before_overwriting = read_until
        for number in range(2500):
            ring.observe(quick_cycle(number))
        while entries := reader.read():
            numbers += [entry[0] for entry in entries]
    assert numbers == list(range(2500))


def test_a_burst_of_a_test_stand_does_not_hide_the_cycle(ring: CycleRing, path: Path) -> None:
    """The samples of the reference are left out if a record cannot hold them."""
    with closing(CycleReader(path)) as reader:
        ring.observe(cycle(0, n_samples=20_000))
        (read,) = reader.read()
    assert isinstance(read, NumberedCycle)
    assert same(read.cycle, cycle(0, n_samples=20_000)._replace(reference=None))


#: Opens a ring and writes into it as fast as it can; argv: the file, the top of the checkout, what to write.
WRITE_AT_FULL_SPEED = """
import itertools, pathlib, sys
sys.path.insert(0, sys.argv[2])
from footsense.ring.cycle_ring import CycleRing
from tests.support.cycles import LEGS, quick_cycle, status
ring = CycleRing(pathlib.Path(sys.argv[1]), LEGS, {}, 1.0, status)
shown = [quick_cycle(number) for number in range(1000)]
print("ready", flush=True)
if sys.argv[3] == "counter":
    while True:
        # By 254 bytes: a part of a counter that is stored byte by byte would be less than before.
        ring._write(bytes(246))
for one in itertools.cycle(shown):
    ring.observe(one)
    ring._status_due_ns %= 25_000_000_000
"""


@contextlib.contextmanager
def written_at_full_speed(path: Path, what: str) -> Iterator[CycleReader]:
    """Let another process write, and yield a reader."""
    command = [sys.executable, "-c", WRITE_AT_FULL_SPEED, str(path), str(Path(__file__).parents[3]), what]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        try:
            assert writer.stdout is not None
            assert writer.stdout.readline() == "ready\n"
            with closing(CycleReader(path)) as reader:
                yield reader
        finally:
            writer.kill()


def test_two_processes_at_full_speed(path: Path) -> None:
    """No reader sees half of a counter: every record is whole, no cycle comes twice, none is missed uncounted.

    The reader lets itself be overtaken, twice at least, as either process may be the faster one.
    """
    last, n_read, n_losses = -1, 0, 0
    with written_at_full_speed(path, "cycles") as reader:
        while n_read < 5_000:
            while n_read >= 2_500 * n_losses and reader.end - reader.position < 3 << 21:
                pass
            for entry in reader.read():
                if isinstance(entry, LostCycles):
                    assert last + 1 + entry.n_cycles == entry.next_cycle_number > last + 1
                    last += entry.n_cycles
                    n_losses += 1
                else:
                    assert n_read == 0 or entry.cycle_number == last + 1
                    last, n_read = entry.cycle_number, n_read + 1
    assert n_losses >= 2


def test_a_counter_never_goes_back(path: Path) -> None:
    """It is stored as one word; of one that is stored byte by byte, a reader on another core sees a part."""
    with written_at_full_speed(path, "counter") as reader:
        for _ in range(15):
            ends = [reader.end for _ in range(200_000)]
            assert ends == sorted(ends)


def test_the_end_and_the_restart_of_a_service_are_noticed(path: Path) -> None:
    """A reader of the former service knows, and gets the rest of it; a new one reads the new service."""
    first = CycleRing(path, LEGS, {}, 40.0, status)
    reader = CycleReader(path)
    assert reader.is_still_written()
    with pytest.raises(FootsenseError, match="another running service writes this file"):
        CycleRing(path, LEGS, {}, 40.0, status)
    assert free_ring(path) == path.with_name(f"ring.{os.getpid()}")
    first.observe(cycle(0))
    first.close()
    first.close()
    assert not reader.is_still_written()
    assert len(reader.read()) == 1
    with pytest.raises(FootsenseError, match="no service runs"):
        CycleReader(path)
    assert free_ring(path) == path
    with closing(CycleRing(path, LEGS, {}, 40.0, status)), closing(CycleReader(path)) as other:
        assert not reader.is_still_written()
        assert other.is_still_written()
    reader.close()
    assert list(path.parent.iterdir()) == []


def test_a_killed_service_is_not_taken_for_a_running_one(path: Path) -> None:
    """SIGKILL leaves its file behind, without its lock; the next service replaces the file."""
    kill = "import os, signal, pathlib, sys; from footsense.ring.cycle_ring import CycleRing\n"
    kill += (
        "CycleRing(pathlib.Path(sys.argv[1]), ['lf'], {}, 1.0, None); os.kill(os.getpid(), signal.SIGKILL)"
    )
    assert subprocess.run([sys.executable, "-c", kill, str(path)], check=False).returncode == -9
    with pytest.raises(FootsenseError, match="its service has ended"):
        CycleReader(path)
    with closing(CycleRing(path, LEGS, {}, 40.0, status)), closing(CycleReader(path)) as reader:
        assert reader.is_still_written()
    path.write_bytes(b"FSRING01" + bytes(1 << 17))  # of the version before
    CycleRing(path, LEGS, {}, 40.0, status).close()


def test_every_user_can_read(ring: CycleRing, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exporter and page are not run by the user of the service."""
    assert path.stat().st_mode & 0o777 == 0o644
    if os.geteuid():
        return  # only root can be another user
    path.parent.chmod(0o755)
    monkeypatch.chdir(path.parent)  # the directories above are this user's alone
    ring.observe(cycle(0))
    groups = os.getgroups()
    os.setgroups([])
    os.setegid(12345)
    os.seteuid(12345)
    try:
        with closing(CycleReader(Path(path.name))) as reader:
            assert len(reader.read()) == 1
            assert reader.is_still_written()
    finally:
        os.seteuid(0)
        os.setegid(0)
        os.setgroups(groups)


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(path))


def _other_owner(path: Path) -> None:
    path.touch()
    os.chown(path, 12345, -1)


OTHERS: dict[str, tuple[Callable[[Path], object], str]] = {
    "fifo": (os.mkfifo, "is not a regular file"),
    "directory": (Path.mkdir, "Is a directory"),
    "symlink": (lambda path: path.symlink_to("/dev/null"), "is not a regular file"),
    "dangling symlink": (lambda path: path.symlink_to("none"), "is not a regular file"),
    "socket": (_socket, "is not a regular file"),
    "of another user": (_other_owner, "belongs to another user"),
    "other content": (lambda path: path.write_text("a letter"), "holds something else|its service has ended"),
}


@pytest.mark.parametrize("kind", OTHERS)
def test_something_else_of_that_name_is_one_line_at_once(path: Path, kind: str) -> None:
    """For writer and reader; nothing waits for the other end of a FIFO, and nothing is replaced."""
    make, reason = OTHERS[kind]
    if kind == "of another user" and os.geteuid():
        pytest.skip("only root can make a file of another user")
    make(path)
    before = path.lstat()
    for attempt in (lambda: CycleRing(path, LEGS, {}, 40.0, status), lambda: CycleReader(path)):
        with pytest.raises(FootsenseError, match=rf"ring: ({reason})"):
            attempt()
    assert path.lstat() == before


@pytest.mark.parametrize("kind", [kind for kind in OTHERS if kind != "other content"])
def test_something_else_with_the_name_of_a_ring_in_the_making(path: Path, kind: str) -> None:
    """One line, and nothing is replaced; what a service has left that was killed is used again."""
    draft = path.with_name("ring.draft")
    if kind == "of another user" and os.geteuid():
        pytest.skip("only root can make a file of another user")
    OTHERS[kind][0](draft)
    before = draft.lstat()
    with pytest.raises(FootsenseError, match="ring"):
        CycleRing(path, LEGS, {}, 40.0, status)
    assert draft.lstat() == before
    assert not path.exists()
    draft.rmdir() if kind == "directory" else draft.unlink()
    draft.write_bytes(b"half of a ring")
    CycleRing(path, LEGS, {}, 40.0, status).close()
    assert list(path.parent.iterdir()) == []


def test_a_file_that_cannot_be_created_leaves_nothing_behind(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No directory, no room, and a name that a sticky bit protects: one line each."""
    with pytest.raises(FootsenseError, match=r"none/ring: cannot be written: No such file"):
        CycleRing(path.parent / "none" / "ring", LEGS, {}, 1.0, status)
    with contextlib.suppress(OSError), pytest.raises(FootsenseError, match=r"ring: cannot be written: "):
        CycleRing(path, LEGS, {}, 1e14, status)

    def forbidden(path: Path, target: Path) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted", str(path), None, str(target))

    monkeypatch.setattr(Path, "rename", forbidden)
    with pytest.raises(FootsenseError, match="ring: cannot be written: Operation not permitted"):
        CycleRing(path, LEGS, {}, 1.0, status)
    assert list(path.parent.iterdir()) == []


def test_readers_look_for_the_service_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Then for a simulation of this user."""
    monkeypatch.setattr(ring_file, "SERVICE_RING", tmp_path / "ring")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    for is_simulated in (True, False):
        path = ring_file.default_ring(is_simulated=is_simulated)
        assert (path == tmp_path / "ring") == (not is_simulated)
        CycleRing(path, LEGS, {"path": str(path)}, 40.0, status)
        with closing(CycleReader()) as reader:
            assert reader.header["path"] == str(path)
