"""What is released: wheel and source distribution, each in a clean environment, where the README's five lines run.

`make release` is `python -m tests.packaging.release`: it leaves both in `dist`, and tags nothing.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
SIMULATED = ROOT / "deploy/simulated.yaml"
_BLOCK = re.compile(r"^```python\n(.*?footsense\.connect.*?)^```", re.DOTALL | re.MULTILINE)
#: A busy computer takes longer for the start of the service than the five lines wait.
_WAIT = "import footsense; footsense.connect({channel!r}, interface='udp_multicast', timeout_s=30).close()"
#: The service walks for so long; the program ends when it has heard nothing for two seconds.
_WALK_S = 6


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=120)


def build(kind: str, folder: Path) -> Path:
    """Build `wheel` or `sdist` into a folder, with the packages of this environment alone."""
    uv = Path(sys.executable).parent / "uv"
    alone = ("--offline", "--no-build-isolation", "--python", sys.executable)
    built = run(uv, "build", f"--{kind}", *alone, "--out-dir", folder, ROOT, cwd=folder)
    assert built.returncode == 0, built.stdout + built.stderr
    (file,) = folder.glob({"wheel": "*.whl", "sdist": "*.tar.gz"}[kind])
    return file


def install(file: Path, place: Path) -> Path:
    """Install a built file and the packages of the lock into an environment of their own; return its programs."""
    assert run(sys.executable, "-m", "venv", place / "venv", cwd=place).returncode == 0
    lock = ROOT / "deploy/requirements.lock"
    alone = ("--no-index", "--no-deps", "--no-build-isolation")
    for options in (("--require-hashes", "-r", lock), (*alone, file)):
        installed = run(place / "venv/bin/pip", "install", "--quiet", *options, cwd=place)
        assert installed.returncode == 0, installed.stderr
    return place / "venv/bin"


def read_forces(programs: Path, place: Path, channel: str = "") -> list[str]:
    """Run the README's five lines beside a simulated service; return the lines that they print.

    Args:
        programs: The environment's programs.
        place: Folder to run in.
        channel: Multicast address in place of the README's, which other programs may use.
    """
    program = _BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))[0]
    config = SIMULATED.read_text(encoding="utf-8")
    if channel:
        program = program.replace("footsense.connect(", f'footsense.connect("{channel}", ', 1)
        config = re.sub(r"channel: \S+", f"channel: {channel}", config)
    (place / "robot.yaml").write_text(config, encoding="utf-8")
    walk = ("run", "--config", "robot.yaml", "--realtime", "--duration", str(_WALK_S))
    with subprocess.Popen([programs / "footsense", *walk], cwd=place, stdout=subprocess.DEVNULL) as service:
        run(programs / "python", "-c", _WAIT.format(channel=channel or None), cwd=place)
        read = run(programs / "python", "-c", program, cwd=place)
        assert service.wait(60) == 0
    assert read.returncode == 0, read.stderr
    return read.stdout.splitlines()


if __name__ == "__main__":
    target = ROOT / "dist"
    target.mkdir(exist_ok=True)
    for old in target.glob("footsense-*"):
        old.unlink()
    for each in ("wheel", "sdist"):
        released = build(each, target)
        with tempfile.TemporaryDirectory() as folder:
            n_forces = len(read_forces(install(released, Path(folder)), Path(folder)))
        assert n_forces > 100, n_forces
        print(f"{released.relative_to(ROOT)}: installs, and reads {n_forces} forces")
