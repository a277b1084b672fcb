"""The split into training, selection and judgement, and the logs that are kept of it."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from footsense.errors import ConfigError
from footsense.lab.walkers import split
from footsense.lab.walkers.gaits import GAITS, WalkerGait
from footsense.lab.walkers.made_up import SLOW, MadeUpLoads
from footsense.lab.walkers.robots import ROBOTS, GroundModel
from footsense.lab.walkers.simulate import WalkerLog
from footsense.lab.walkers.slow_loads import RISE_S
from footsense.lab.walkers.split import (
    GROUNDS,
    JUDGEMENT,
    KNOWN_JUDGEMENT,
    NEW_JUDGEMENT,
    SELECTION,
    TRAINING,
    WalkerRun,
)

PARTS = (TRAINING, SELECTION, JUDGEMENT)


def test_the_parts_share_no_robot_no_ground_and_no_seed() -> None:
    """Nor a ground of another name; and within a part no two runs have one seed."""
    for of_part in (
        [{run.robot for run in part} for part in PARTS],
        [{run.ground for run in part} for part in PARTS],
        [{GROUNDS[run.ground] for run in part} for part in PARTS],
        [{run.seed for run in part} for part in PARTS],
    ):
        assert len(set[object]().union(*of_part)) == sum(map(len, of_part))
    assert all(len({run.seed for run in part}) == len(part) for part in PARTS)


def footfalls(gait: WalkerGait, kind: str) -> frozenset[tuple[frozenset[str], ...]]:
    """Return the order in which the legs of a kind touch down, those at one time together, from any of them."""
    robot = next(robot for robot in ROBOTS.values() if robot.kind == kind)
    legs, phases = robot.legs, dict(zip(robot.legs, gait.phases(robot).tolist(), strict=True))
    order = [frozenset(leg for leg in legs if phases[leg] == phase) for phase in sorted(set(phases.values()))]
    return frozenset(tuple(order[first:] + order[:first]) for first in range(len(order)))


def is_like(gait: WalkerGait, other: WalkerGait, kind: str) -> bool:
    """Whether a gait is like another: the same footfalls, a like duty, and both all the time."""
    moves = [one.forward_m_s or one.left_m_s or one.turn_rad_s for one in (gait, other)]
    return (
        bool(moves[0] and moves[1])
        and not gait.bouts
        and footfalls(gait, kind) == footfalls(other, kind)
        and abs(gait.duty_rel - other.duty_rel) <= 0.1
    )


def test_selection_and_judgement_walk_in_gaits_that_nothing_was_trained_on() -> None:
    """Nor one in those of the other; known gaits of judgement are those of training."""
    trained, selected, new = (
        {(run.kind, run.gait) for run in part} for part in (TRAINING, SELECTION, NEW_JUDGEMENT)
    )
    assert {(run.kind, run.gait) for run in KNOWN_JUDGEMENT} <= trained
    assert KNOWN_JUDGEMENT + NEW_JUDGEMENT == JUDGEMENT
    for part, others in ((selected, trained), (new, trained | selected)):
        for kind, name in part:
            gait = GAITS[name]
            assert gait.forward_m_s > 0.0, name
            for other_kind, other in others:
                assert kind != other_kind or not is_like(gait, GAITS[other], kind), (kind, name, other)
    both = {kind for kind, _ in new}
    for part in (selected, new):
        assert {kind for kind, name in part if GAITS[name].bouts} == both
        assert {kind for kind, name in part if name in split.DRAGGED} == both


def test_slow_loads_rise_as_slowly_as_they_say() -> None:
    """Each touch from the first hundredth to the most, with a mass that pulls at the foot in swing."""
    log = MadeUpLoads(SLOW, 1, 40.0).kept_log()
    assert np.array_equal(log.force_n, MadeUpLoads(SLOW, 1, 40.0).kept_log().force_n)
    rises_s = []
    for load_n in (log.force_n * log.normal).sum(axis=2).T:
        edges = np.flatnonzero(np.diff((load_n > 0.01).astype(int)))
        if load_n[0] > 0.01:
            edges = edges[1:]
        rises_s += [
            float(np.argmax(load_n[first:last] > 0.95 * load_n[first:last].max()) * 1e-3)
            for first, last in zip(edges[::2], edges[1::2], strict=False)
        ]
    assert len(rises_s) > 40
    assert min(rises_s) > 0.1
    assert 0.4 < np.median(rises_s) < max(rises_s) < RISE_S[1] + 1.0
    assert np.ptp(log.inertial_n(10.0), axis=0).min(axis=0).max() > 0.0


def test_a_run_is_simulated_once(tmp_path: Path) -> None:
    """The file has what was simulated, in single precision; a ground that is none is one line."""
    run = WalkerRun("hexapod-300g", "tripod", "tiles", 1, 0.1)
    file = run.saved(tmp_path)
    written_ns = file.stat().st_mtime_ns
    log = WalkerLog.load(run.saved(tmp_path))
    assert file.stat().st_mtime_ns == written_ns
    made = run.log()
    assert log.legs == made.legs
    for name in ("t_s", "force_n", "normal", "slip_m_s", "acceleration_m_s2"):
        np.testing.assert_allclose(getattr(log, name), getattr(made, name), rtol=1e-6, atol=1e-9)
    with pytest.raises(ConfigError, match=r"no ground 'mud': there are flat, slope-10, "):
        run._replace(ground="mud").saved(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot keep a log"):
        run.saved(tmp_path / "file")


def test_training_keeps_its_logs_and_leaves_out_who_falls(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the user's cache, apart for each version of MuJoCo."""
    cliff = GroundModel(friction=0.9, time_constant_s=0.008, slope_deg=(60.0, 90.0))
    runs = [WalkerRun("quadruped-300g", "stand", ground, 1, 1.0) for ground in ("cliff", "floor")]
    monkeypatch.setitem(split.GROUNDS, "cliff", cliff)
    monkeypatch.setattr(split, "TRAINING", (runs[0], runs[1]._replace(duration_s=0.1)))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    said: list[str] = []
    (log,) = split.training_logs(said.append, jobs=1)
    assert len(log.t_s) == 100
    assert len(said) == 1
    assert said[0].startswith(
        "left out quadruped-300g stand cliff: quadruped-300g falls in gait stand after "
    )
    assert [path.name for path in split.cache_folder().iterdir()] == ["quadruped-300g_stand_floor_1_0.1s.npz"]
    kept = split.cache_folder()
    assert kept.is_relative_to(tmp_path)
    monkeypatch.setattr(mujoco, "__version__", "0")
    assert split.cache_folder() != kept
