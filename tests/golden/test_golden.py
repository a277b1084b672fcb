"""A recorded walk still gives the forces that it gave when it was recorded."""

from pathlib import Path

from footsense.frames import State
from footsense.recording.replay import Replay
from tests.system.command import footsense

GOLDEN = Path(__file__).parent / "measured_walk.mcap"


def test_the_golden_walk_is_a_walk() -> None:
    """Four seconds of six legs that are tared, carry and swing: a replay of nothing would prove nothing."""
    cycles = list(Replay(GOLDEN))
    assert len(cycles) > 150
    fz_n = [cycle.forces.force_n[:, 2] for cycle in cycles if (cycle.forces.state == State.VALID).all()]
    assert len(fz_n) > 120
    assert all(max(forces) > 0.9 for forces in zip(*fz_n, strict=True))
    assert all(min(forces) < 0.01 for forces in zip(*fz_n, strict=True))


def test_the_golden_walk_gives_the_same_forces() -> None:
    """Bit for bit on the machine that recorded it, to 1 mN on any other."""
    result = footsense("replay", GOLDEN, "--check")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.startswith(f"{len(list(Replay(GOLDEN)))} cycles equal")
