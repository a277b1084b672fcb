"""What is released: two wheels and a source distribution, in clean environments, where the README's five lines run.

`make release` is `python -m tests.packaging.release`: it leaves them in `dist`, and tags nothing.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from footsense.clock import stopwatch_ns

ROOT = Path(__file__).parents[2]
CLIENT = ROOT / "deploy/client"
LOCK = ROOT / "deploy/requirements.lock"
SIMULATED = ROOT / "deploy/simulated.yaml"
_BLOCK = re.compile(r"^```python\n(.*?footsense\.connect.*?)^```", re.DOTALL | re.MULTILINE)
#: A busy computer takes longer for the start of the service than the five lines wait.
_WAIT = "import footsense; footsense.connect({channel!r}, interface='udp_multicast', timeout_s=30).close()"
#: The service walks for so long; the program ends when it has heard nothing for two seconds.
_WALK_S = 6


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=120)


def build(kind: str, folder: Path, project: Path = ROOT) -> Path:
    """Build `wheel` or `sdist` of a project into a folder, with the packages of this environment alone."""
    uv = Path(sys.executable).parent / "uv"
    alone = ("--offline", "--no-build-isolation", "--python", sys.executable)
    built = run(uv, "build", f"--{kind}", *alone, "--out-dir", folder, project, cwd=folder)
    assert built.returncode == 0, built.stdout + built.stderr
    name = "footsense" if project == ROOT else "footsense_client"
    (file,) = folder.glob(f"{name}-*{ {'wheel': '.whl', 'sdist': '.tar.gz'}[kind] }")
    return file


def environment(place: Path, *installs: tuple[str | Path, ...]) -> Path:
    """Make an environment with what each call of `pip install` brings; return its programs."""
    assert run(sys.executable, "-m", "venv", place / "venv", cwd=place).returncode == 0
    for arguments in installs:
        installed = run(place / "venv/bin/pip", "install", "--quiet", *arguments, cwd=place)
        assert installed.returncode == 0, installed.stderr
    return place / "venv/bin"


def robot(place: Path, *released: str | Path) -> Path:
    """Return an environment with the packages of the lock, and what was built, as a robot installs them."""
    alone = ("--no-index", "--no-deps", "--no-build-isolation")
    return environment(place, ("--require-hashes", "-r", LOCK), (*alone, *released))


def controller(place: Path, wheel: Path) -> Path:
    """Return an environment with the client's wheel and what pip installs for it, in the versions of the lock."""
    pins = re.findall(r"^([\w.-]+==[^ ;]+)", LOCK.read_text(encoding="utf-8"), re.MULTILINE)
    (place / "versions.txt").write_text("\n".join(pins), encoding="utf-8")
    return environment(place, ("-c", place / "versions.txt", wheel))


def read_forces(programs: Path, place: Path, channel: str = "", service: Path | None = None) -> list[str]:
    """Run the README's five lines beside a simulated service; return the lines that they print.

    Args:
        programs: The environment's programs.
        place: Folder to run in.
        channel: Multicast address in place of the README's, which other programs may use.
        service: Programs of the environment with the service; None for the same.
    """
    program = _BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))[0]
    config = SIMULATED.read_text(encoding="utf-8")
    if channel:
        program = program.replace("footsense.connect(", f'footsense.connect("{channel}", ', 1)
        config = re.sub(r"channel: \S+", f"channel: {channel}", config)
    (place / "robot.yaml").write_text(config, encoding="utf-8")
    walk = ("run", "--config", "robot.yaml", "--realtime", "--duration", str(_WALK_S))
    with subprocess.Popen(
        [(service or programs) / "footsense", *walk], cwd=place, stdout=subprocess.DEVNULL
    ) as walking:
        run(programs / "python", "-c", _WAIT.format(channel=channel or None), cwd=place)
        read = run(programs / "python", "-c", program, cwd=place)
        assert walking.wait(60) == 0
    assert read.returncode == 0, read.stderr
    return read.stdout.splitlines()


def figures(programs: Path) -> str:
    """Return what a client's environment has besides pip, its size, and how long `footsense.connect` takes to load."""
    listed = run(programs / "pip", "list", "--format", "json", cwd=programs)
    packages = {package["name"] for package in json.loads(listed.stdout)} - {"pip", "setuptools"}
    (site,) = programs.parent.glob("lib/python*/site-packages")
    folders = [
        path for path in site.iterdir() if not path.name.startswith(("pip", "setuptools", "pkg_", "_dist"))
    ]
    files = [path for folder in folders for path in (folder.rglob("*") if folder.is_dir() else [folder])]
    size = sum(path.stat().st_size for path in files if path.is_file() and path.suffix != ".pyc")
    seconds = {}
    for program in ("pass", "import footsense; footsense.connect"):
        times = []
        for _ in range(5):
            begin_ns = stopwatch_ns()
            run(programs / "python", "-c", program, cwd=programs)
            times.append(stopwatch_ns() - begin_ns)
        seconds[program] = 1e-9 * min(times)
    first, second = seconds.values()
    return f"{', '.join(sorted(packages))}; {1e-6 * size:.1f} MB; imported in {second - first:.2f} s"


if __name__ == "__main__":
    target = ROOT / "dist"
    target.mkdir(exist_ok=True)
    for old in target.glob("footsense*"):
        old.unlink()
    client, wheel, sdist = build("wheel", target, CLIENT), build("wheel", target), build("sdist", target)
    of_sdist = f"footsense-client @ {sdist.as_uri()}#subdirectory=deploy/client"
    each: list[list[str | Path]] = [[client, wheel], [of_sdist, sdist], [client]]
    for installed in each:
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            alone = installed == [client]
            programs = controller(place, client) if alone else robot(place, *installed)
            n_forces = len(
                read_forces(programs, place, service=Path(sys.executable).parent if alone else None)
            )
            assert n_forces > 100, n_forces
            print(f"{Path(installed[-1]).relative_to(ROOT)}: installs, and reads {n_forces} forces")
            if alone:
                print(figures(programs))
