"""A recording gives back every bit that it was given, or says what it cannot give."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from footsense.errors import RecordingError
from footsense.frames import Cause, CommandResult, Cycle, GaitEvent, GaitEventKind, Result
from footsense.recording.compare import first_difference, same_processor_and_libraries
from footsense.recording.machine import platform_versions
from footsense.recording.mcap_writer import McapFile
from footsense.recording.recover import recover
from footsense.recording.replay import Replay, ReplayClock, ReplaySource
from footsense.ring.records import LostCycles, NumberedCycle
from tests.support.cycles import LEGS, TARE, cycle, read_until_damage, same, write
from tests.support.frames import gait_frame


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[Cycle]]:
    """Return the bytes of a recording of 60 cycles in six chunks, and the cycles."""
    cycles = [cycle(number, n_samples=number % 3) for number in range(60)]
    return write(tmp_path_factory.mktemp("walk") / "walk.mcap", cycles).read_bytes(), cycles


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scratch") / "damaged.mcap"


outcome = st.builds(CommandResult, st.just(TARE), st.sampled_from(Result), st.text(max_size=40))


samples = st.none() | st.integers(0, 6)


@given(st.integers(0, 2**32), st.lists(outcome, max_size=2), samples)
@settings(max_examples=25)
def test_the_file_keeps_every_bit(
    scratch: Path, seed: int, outcomes: list[CommandResult], n_samples: int | None
) -> None:
    """Floats of any value, NaN, infinities and -0.0, and reasons in any script come out of the file again."""
    some = {"outcomes": tuple(outcomes), "n_samples": n_samples}
    shown = [cycle(number, seed, **some, warm=number % 3 == 1) for number in range(5)]  # type: ignore[arg-type]
    read, damage = read_until_damage(write(scratch, shown))
    assert damage is None
    assert all(same(a, b) for a, b in zip(shown, read, strict=True))


def test_a_truncated_file_says_what_is_lost(scratch: Path, walk: tuple[bytes, list[Cycle]]) -> None:
    """The error names the byte, the number of whole cycles and their last time."""
    whole, _ = walk
    scratch.write_bytes(whole[: len(whole) // 2])
    read, damage = read_until_damage(scratch)
    assert len(read) == 30
    assert f"of {len(whole) // 2} (" in str(damage)
    assert "30 cycles are whole, up to 0.725 s after the first; what follows is lost" in str(damage)


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
    assert recovered.n_recovered_cycles == len(read) > 0
    assert all(same(a, b) for a, b in zip(cycles, read, strict=False))
    with (tmp_path / "walk.mcap").open("rb") as file:
        topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
    assert topics.count("/scan") == topics.count("/force") == len(read)
    assert topics.count("/reference") == sum(
        len(one.reference.t_ns) for one in read if one.reference is not None
    )


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
        assert tuple(source.commands()) == then.started_commands
        assert source.commands() == []
        assert clock.now_ns() == then.forces.t_sent_ns
    assert source.read() is None
    assert source.damage is None


def test_replay_counts_what_was_lost(scratch: Path) -> None:
    """The source gives the scans on both sides of a gap, and tells the gap with the scan after it."""
    with scratch.open("wb") as file:
        recording = McapFile(file.fileno(), {"legs": ",".join(LEGS)})
        recording.add_entry(NumberedCycle(0, cycle(0)))
        recording.add_entry(LostCycles(4, 0, 3))
        recording.add_entry(NumberedCycle(4, cycle(4)))
        recording.finish()
    source = ReplaySource(Replay(scratch))
    seen = [(scan.sequence, source.lost) for scan in iter(source.read, None)]
    assert seen == [(0, 0), (4, 3)]


def test_compare_names_the_first_difference() -> None:
    """The difference is told with its leg, field and both values; 1 mN is none on another machine."""
    then, now = cycle(0).forces, cycle(0).forces
    then.force_n[3], now.force_n[3] = (0.1, 0.2, np.nan), (0.1, 0.2 + 5e-4, np.nan)
    found = first_difference(then, now, exact=True, legs=LEGS)
    assert found == "cycle 0, sent at 0.000 s, leg rf: fy_n was 0.2, is now 0.2005"
    now.force_n[:], now.sigma_n[:] = then.force_n, then.sigma_n
    now.force_n[3, 1] += 5e-4
    assert first_difference(then, now, exact=False, legs=LEGS) is None
    now.state[1] = (then.state[1] + 1) % 10
    assert "leg lm: state was" in str(first_difference(then, now, exact=False, legs=LEGS))


def test_compare_looks_behind_the_state_and_at_the_baseline() -> None:
    """Another cause or another baseline under the same forces is a difference."""
    then, now = cycle(0).forces, cycle(0).forces
    then.cause[2], now.cause[2] = Cause.ROW_OPEN, Cause.COLUMN_OPEN
    found = first_difference(then, now, exact=False, legs=LEGS)
    assert "leg lr: cause was ROW_OPEN, is now COLUMN_OPEN" in str(found)
    now.cause[2] = then.cause[2]
    then.baseline.worst_pf[4], now.baseline.worst_pf[4] = 0.5, 0.5 + 1e-9
    assert first_difference(then, now, exact=False, legs=LEGS) is None
    found = first_difference(then, now, exact=True, legs=LEGS)
    assert "leg rm: baseline_worst_pf was 0.5, is now" in str(found)


def test_compare_looks_at_the_gait() -> None:
    """One that was not there or is not there any more, another load share, or an event less is a difference."""
    t_ns = 100_000_000
    event = GaitEvent(GaitEventKind.TOUCHDOWN, 0, t_ns, 0.002)
    plain = cycle(0).forces
    then = plain._replace(gait=gait_frame(t_ns, 6, events=(event,)))
    share = np.array([0.5, 0.1, 0.1, 0.1, 0.1, 0.1])
    for now, words in (
        (plain, "had a gait, has none now"),
        (then._replace(gait=gait_frame(t_ns, 6)), "the gait events were"),
        (
            then._replace(gait=gait_frame(t_ns, 6, events=(event,), load_share=share)),
            "lf: load_share was 0.1666",
        ),
    ):
        assert words in str(first_difference(then, now, exact=False, legs=LEGS))
    assert "had no gait, has one now" in str(first_difference(plain, then, exact=False, legs=LEGS))
    assert first_difference(then, then, exact=True, legs=LEGS) is None


def test_the_same_machine_has_the_same_processor_and_libraries() -> None:
    """Bits are compared only where the header names this processor and these versions."""
    here = platform_versions()
    assert same_processor_and_libraries({**here, "scene": "x"}, here)
    assert not same_processor_and_libraries({**here, "numpy": "0"}, here)
    assert not same_processor_and_libraries({}, here)
