"""A recording gives back every bit that it was given, or says what it cannot give."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footsense.errors import RecordingError
from footsense.frames import Cause, CommandResult, Cycle, GaitEvent, GaitEventKind, Result
from footsense.recording.compare import Comparison, differing_entries
from footsense.recording.machine import platform_versions
from footsense.recording.replay import Replay
from tests.support.cycles import LEGS, TARE, cycle, read_until_damage, same, write
from tests.support.frames import contact_frame, gait_frame


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


def with_forces(**values: Any) -> Cycle:
    """Return a cycle whose forces have some other values."""
    one = cycle(0)
    return one._replace(forces=contact_frame(1_000, 6)._replace(**values))


def first_difference(recorded: Cycle, recomputed: Cycle, *, exact: bool = False) -> str | None:
    return Comparison(LEGS, exact=exact).add(recorded, recomputed)


def test_compare_names_the_first_difference() -> None:
    """The difference is told with its leg, field and both values; 1 mN is none on another machine."""
    force_n = np.full((6, 3), np.nan)
    force_n[3] = 0.1, 0.2, np.nan
    then, now = with_forces(force_n=force_n), with_forces(force_n=force_n + np.array([0.0, 5e-4, 0.0]))
    found = first_difference(then, now, exact=True)
    assert found == "cycle 0, sent at 0.000 s, leg rf: fy_n was 0.2, is now 0.2005"
    assert first_difference(then, now) is None
    now = with_forces(force_n=force_n + np.array([0.0, 2e-3, 0.0]))
    assert "leg rf: fy_n was 0.2, is now 0.202" in str(first_difference(then, now))
    known = with_forces(force_n=np.nan_to_num(force_n))
    assert "leg lf: fx_n was None, is now 0.0" in str(first_difference(then, known))


def test_compare_looks_behind_the_state_and_at_the_baseline() -> None:
    """Another cause or another baseline under the same forces is a difference."""
    causes = [np.full(6, cause, np.uint8) for cause in (Cause.ROW_OPEN, Cause.COLUMN_OPEN)]
    found = first_difference(*(with_forces(cause=cause) for cause in causes))
    assert "leg lf: cause was ROW_OPEN, is now COLUMN_OPEN" in str(found)
    baseline = contact_frame(1_000, 6).baseline
    then, near, far = (
        with_forces(baseline=baseline._replace(worst_pf=np.full(6, worst_pf)))
        for worst_pf in (0.5, 0.5 + 1e-9, 0.5 + 1e-5)
    )
    assert first_difference(then, near) is None
    for now, exact in ((near, True), (far, False)):
        found = first_difference(then, now, exact=exact)
        assert "leg lf: baseline_worst_pf was 0.5, is now" in str(found)


def test_compare_looks_at_the_gait() -> None:
    """One that was not there or is not there any more, another load share, or an event less is a difference."""
    t_ns = 100_000_000
    event = GaitEvent(GaitEventKind.TOUCHDOWN, 0, t_ns, 0.002)
    gait = gait_frame(t_ns, 6, events=(event,))
    then, plain = with_forces(gait=gait), with_forces()
    share = np.array([0.5, 0.1, 0.1, 0.1, 0.1, 0.1])
    for now, words in (
        (plain, "had 1 gaits, has 0 now"),
        (with_forces(gait=gait._replace(events=())), "had 1 gait events, has 0 now"),
        (with_forces(gait=gait._replace(events=(event._replace(leg=1),))), "leg was lf, is now lm"),
        (with_forces(gait=gait._replace(load_share=share)), "lf: load_share was 0.1666"),
    ):
        assert words in str(first_difference(then, now))
    assert "had 0 gaits, has 1 now" in str(first_difference(plain, then))
    dated = with_forces(gait=gait._replace(events=(event._replace(t_ns=t_ns + 1),)))
    assert first_difference(then, dated) is None
    assert "t_ns was 100000000, is now 100000001" in str(first_difference(then, dated, exact=True))


def test_compare_counts_cycles_whose_last_bits_differ() -> None:
    """By a unit in the last place: the cycles are equal, and the line says by how much not bit for bit."""
    comparison = Comparison(LEGS)
    sigma_n = np.full((6, 3), 0.004)
    for number in range(4):
        now_n = np.nextafter(sigma_n, 1.0) if number == 2 else sigma_n
        assert comparison.add(with_forces(sigma_n=sigma_n), with_forces(sigma_n=now_n)) is None
    assert (comparison.n_cycles, comparison.n_bitwise) == (4, 3)
    assert comparison.summary() == (
        "4 cycles equal to 1 mN, 3 bit for bit; largest differences: "
        "sigma_x_n 9e-19, sigma_y_n 9e-19, sigma_z_n 9e-19"
    )


def test_what_was_another_at_the_recording_is_named() -> None:
    """The header has processor, C library and BLAS routines beside the versions."""
    here = platform_versions()
    assert {"processor", "libc", "blas", "numpy"} <= here.keys()
    assert differing_entries({**here, "scene": "x"}, here) == []
    assert differing_entries({**here, "numpy": "0", "blas": ""}, here) == ["blas", "numpy"]
    assert differing_entries({}, here) == list(here)
