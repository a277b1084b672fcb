"""The examples with a robot or a sensor beside footsense, run as their users would."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
TIMEOUT_S = 120


def run_example(name: str, *arguments: str | Path, **environment: str) -> str:
    """Run an example to its end; return what it prints."""
    done = subprocess.run(
        [sys.executable, "-W", "error", EXAMPLES / name, *arguments],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_robot_in_mujoco_walks_and_its_feet_publish(tmp_path: Path) -> None:
    told = run_example("mujoco_foot.py", tmp_path / "foot.png", MPLBACKEND="Agg")
    walked_m, usable_percent = map(float, re.findall(r"(\d+\.\d+)", told))
    assert walked_m > 0.15
    assert 90.0 < usable_percent < 99.9
    assert (tmp_path / "foot.png").read_bytes().startswith(b"\x89PNG")
