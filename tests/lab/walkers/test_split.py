"""The split into training, selection and judgement, and the logs that are kept of it."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from footsense.errors import ConfigError
from footsense.lab.walkers import split
from footsense.lab.walkers.robots import GroundModel
from footsense.lab.walkers.simulate import WalkerLog
from footsense.lab.walkers.split import GROUNDS, JUDGEMENT, SELECTION, TRAINING, WalkerRun

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
