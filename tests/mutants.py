"""Changes the code in small ways, one at a time, and counts the changes that no fast test notices.

    python -m tests.mutants footsense/can --sample 200

Works in `build/mutants`, on copies. A change that survives there is a hole in the tests, or has its reason in
`mutants.md`. mutmut changes functions only: no constants of modules, nothing that is decorated.
"""

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
WORK = ROOT / "build/mutants"

#: The tests that have to notice a change: the fast ones of each room. A survivor is run against all that reach it.
TESTS = {
    "footsense/acquisition": (
        "tests/unit/acquisition",
        "tests/unit/daemon/test_probe.py",
        "tests/protocol",
        "tests/contract",
    ),
    "footsense/estimation": ("tests/unit/estimation", "tests/fuzz/test_network_file.py"),
    "footsense/can": ("tests/unit/can", "tests/unit/firmware_interface"),
    "footsense/client": ("tests/contract/test_link.py", "tests/unit/cli/test_monitor.py"),
}

_COPIED = ("footsense", "firmware_interface", "models", "tests", "docs", "deploy", "README.md", "Makefile")
_NOTICED = ("killed", "timeout", "segfault", "suspicious", "caught by type check")
_CONFIG = """
[tool.mutmut]
source_paths = ["footsense"]
only_mutate = ["{path}*"]
also_copy = [{also_copy}]
pytest_add_cli_args_test_selection = [{tests}]
pytest_add_cli_args = ["-p", "no:cacheprovider"]
do_not_mutate_patterns = ['_log[.](debug|info|warning|error)', 'cast[(]']
timeout_constant = 5.0
"""


class Kept(NamedTuple):
    """A class of survivors that stays.

    Attributes:
        function: Pattern of the function, as a file name's.
        line: Regular expression found in the changed line.
    """

    function: str
    line: str


def kept() -> list[Kept]:
    """Return the classes of `mutants.md`, whose rows are: function, line, reason."""
    rows = re.findall(r"^\| `(.+?)` \| `(.+?)` \|", (ROOT / "tests/mutants.md").read_text(), re.MULTILINE)
    return [Kept(function, line.replace("\\|", "|")) for function, line in rows]


def prepare(path: str) -> None:
    """Copy the project to where it is changed, with the settings for the modules under `path`."""
    room = next(room for room in TESTS if path.startswith(room))
    shutil.rmtree(WORK, ignore_errors=True)
    # What Python does not find on its path at its start it never looks for again.
    (WORK / "mutants").mkdir(parents=True)
    for name in _COPIED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, WORK / name)
    quoted = [", ".join(f'"{one}"' for one in names) for names in (_COPIED[1:], TESTS[room])]
    config = _CONFIG.format(path=path, also_copy=quoted[0], tests=quoted[1])
    (WORK / "pyproject.toml").write_text((ROOT / "pyproject.toml").read_text() + config)


def mutmut(*arguments: str) -> str:
    """Run mutmut on the copy and return its output."""
    environment = os.environ | {"PYTHONPATH": str(WORK / "mutants"), "OMP_NUM_THREADS": "1"}
    command = [str(Path(sys.executable).with_name("mutmut")), *arguments]
    done = subprocess.run(command, cwd=WORK, env=environment, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


def statuses() -> dict[str, str]:
    """Return the status of every change by its name."""
    lines = (line.strip().rpartition(": ") for line in mutmut("results", "--all", "true").splitlines())
    return {name: status for name, _, status in lines if name}


def main() -> int:
    """Print the score and the survivors.

    Returns:
        The exit code: 1 if a change survived for which `mutants.md` has no reason.
    """
    parser = argparse.ArgumentParser(description="Count the changes that no fast test notices.")
    parser.add_argument("path", help=f"{', '.join(TESTS)}, or a module of one")
    parser.add_argument("--sample", type=int, default=0, help="so many changes, drawn at random; 0 for all")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    prepare(options.path)
    # A run of none makes all changes, and learns which test reaches what.
    said = mutmut("run", "--max-children", "1", "none")
    names = sorted(statuses())
    if not names or "nothing matches" not in said:
        sys.exit(said[-4000:])
    drawn = random.Random(options.seed).sample(names, min(options.sample or len(names), len(names)))
    mutmut("run", "--max-children", "1", *drawn)
    found = {name: status for name, status in statuses().items() if name in set(drawn)}
    survivors = sorted(name for name, status in found.items() if status not in _NOTICED)
    classes, open_ = kept(), 0
    for name in survivors:
        diff = [line for line in mutmut("show", name).splitlines() if re.match(r"[-+](?![-+])", line)]
        if any(
            fnmatch(name, f"{one.function}__mutmut_*") and re.search(one.line, diff[0]) for one in classes
        ):
            continue
        open_ += 1
        print(f"{found[name]} {name}", *diff, sep="\n    ")
    n_killed = len(found) - len(survivors)
    print(
        f"{options.path}: {n_killed} of {len(found)} changes noticed, {100 * n_killed / len(found):.1f} % "
        f"({len(names)} in all); {len(survivors) - open_} kept with a reason, {open_} without"
    )
    return 1 if open_ else 0


if __name__ == "__main__":
    sys.exit(main())
