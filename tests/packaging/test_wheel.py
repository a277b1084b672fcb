"""What a robot installs: both wheels and the packages of the lock file run by themselves, far from the checkout.

It needs a package index, as the set-up of the checkout does.
"""

import json
from pathlib import Path

import pytest

from tests.packaging import release
from tests.packaging.release import CLIENT, ROOT, build, read_forces, run

#: Packages of the lab and of development that a robot does not carry.
NOT_ON_A_ROBOT = {
    "ngsolve",
    "jax",
    "jinja2",
    "optax",
    "onnx",
    "scipy",
    "matplotlib",
    "cantools",
    "pytest",
    "hypothesis",
}


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an environment with the packages of the lock file and both wheels."""
    place = tmp_path_factory.mktemp("robot")
    wheels = [build("wheel", place, project) for project in (CLIENT, ROOT)]
    assert sum(wheel.stat().st_size for wheel in wheels) < 10e6
    return release.robot(place, *wheels)


def test_the_robot_carries_no_lab(robot: Path, tmp_path: Path) -> None:
    """Nothing that meshes, trains or draws is among the runtime packages."""
    listed = run(robot / "pip", "list", "--format", "json", cwd=tmp_path)
    packages = {package["name"].lower() for package in json.loads(listed.stdout)}
    assert "footsense" in packages
    assert packages & NOT_ON_A_ROBOT == set()


def test_the_wheel_holds_every_template(robot: Path) -> None:
    """The texts of the report's pages are no Python, and are packaged all the same."""
    (package,) = robot.parent.glob("lib/python*/site-packages/footsense")
    installed = {path.relative_to(package) for path in package.rglob("*.j2")}
    assert installed
    assert installed == {path.relative_to(ROOT / "footsense") for path in (ROOT / "footsense").rglob("*.j2")}


def test_the_installed_daemon_walks(robot: Path, tmp_path: Path) -> None:
    """From an empty directory the built-in robot walks, and the summary counts its scans."""
    walked = run(robot / "footsense", "run", "--duration", "1", "--summary", "json", cwd=tmp_path)
    assert walked.returncode == 0, walked.stderr
    assert json.loads(walked.stdout)["cycles"] > 0
    assert list(tmp_path.iterdir()) == []


def test_the_five_lines_of_the_readme_read_forces(robot: Path, tmp_path: Path) -> None:
    """Force, sigma, age and contact of a leg, some seventy times a second, until the service ends."""
    lines = read_forces(robot, tmp_path, channel="239.74.163.91")
    usable = [line for line in lines if " True " in line]
    assert len(usable) > 200
    assert any(line.endswith("True True") for line in usable)


def test_the_locked_packages_give_the_same_forces(robot: Path, tmp_path: Path) -> None:
    """The golden recording replays with the versions that a robot installs."""
    golden = ROOT / "tests/golden/measured_walk.mcap"
    replayed = run(robot / "footsense", "replay", golden, "--check", cwd=tmp_path)
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr


def test_the_lab_names_its_extra(robot: Path, tmp_path: Path) -> None:
    """Without the extra the lab says in one line how to get it."""
    refused = run(robot / "footsense", "lab", "build", cwd=tmp_path)
    assert refused.returncode != 0
    (line,) = refused.stderr.splitlines()
    assert "'.[lab]'" in line
