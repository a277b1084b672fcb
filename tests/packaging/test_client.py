"""What a controller installs: the client's wheel by itself, without the service, numpy or a network.

It needs a package index, as the set-up of the checkout does.
"""

import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

from tests.packaging.release import CLIENT, ROOT, build, controller, figures, read_forces, run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("wheel", tmp_path_factory.mktemp("wheel"), CLIENT)


@pytest.fixture(scope="module")
def programs(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return controller(tmp_path_factory.mktemp("controller"), wheel)


def test_no_file_is_in_both_wheels_and_none_is_in_neither(wheel: Path, tmp_path: Path) -> None:
    """An upgrade of one would take a file of the other away."""
    held = [ZipFile(path).namelist() for path in (wheel, build("wheel", tmp_path))]
    client, service = ({name for name in names if ".dist-info/" not in name} for names in held)
    assert client & service == set()
    tracked = run("git", "ls-files", "footsense", "firmware_interface", cwd=ROOT).stdout.split()
    assert set(tracked) - client - service == set()
    assert wheel.stat().st_size < 100_000


def test_the_five_lines_of_the_readme_need_the_client_alone(programs: Path, tmp_path: Path) -> None:
    lines = read_forces(programs, tmp_path, "239.74.163.92", service=Path(sys.executable).parent)
    assert sum(" True " in line for line in lines) > 200


def test_it_is_small_and_loads_python_can_for_a_simulation_alone(programs: Path, tmp_path: Path) -> None:
    told, size, _ = figures(programs).split("; ")
    assert told == "footsense-client, msgpack, packaging, python-can, typing_extensions, wrapt"
    assert float(size.split()[0]) < 5.0
    program = """
import sys, footsense
try:
    footsense.connect({!r}, timeout_s=0.1)
except footsense.FootsenseError as error:
    print(*sorted({{name.partition(".")[0] for name in sys.modules}} - sys.stdlib_module_names))
"""
    loaded = run(programs / "python", "-c", program.format("no-can"), cwd=tmp_path).stdout.split()
    assert {*loaded} - {"__main__", "_distutils_hack"} == {"firmware_interface", "footsense"}


@pytest.mark.parametrize("name", ["read", "Foot"])
def test_what_the_client_lacks_says_in_one_line_what_to_install(
    programs: Path, tmp_path: Path, name: str
) -> None:
    asked = run(programs / "python", "-c", f"from footsense import {name}", cwd=tmp_path)
    lacking = f"ImportError: footsense.{name} needs footsense.api, which footsense-client alone lacks; "
    assert (
        asked.stderr.splitlines()[-1]
        == f"{lacking}in the clone of footsense: activate its environment, or pip install deploy/client ."
    )


@pytest.mark.parametrize("name", ["estimate_array.py", "simulate_foot.py"])
def test_an_example_that_needs_all_of_footsense_says_so_in_one_line(
    programs: Path, tmp_path: Path, name: str
) -> None:
    (line,) = run(programs / "python", ROOT / "examples" / name, cwd=tmp_path).stderr.splitlines()
    assert line == (
        f"No module named 'numpy': {name} needs all of footsense; in its clone: pip install deploy/client ."
    )
