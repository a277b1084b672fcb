"""What a machine is made from: commands, Debian's packages, and folders that are made once for what goes into them."""

import fcntl
import hashlib
import os
import shutil
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path


class LackingError(RuntimeError):
    """This computer lacks what the machine is made from."""


def fetch(*command: str | Path) -> None:
    """Run a command that needs the network.

    Raises:
        LackingError: It failed; with its last line.
    """
    try:
        run(*command)
    except RuntimeError as error:
        raise LackingError(f"{command[0]} failed: {str(error).strip().splitlines()[-1]}") from error


def run(*command: str | Path, cwd: Path | None = None) -> str:
    """Run a command and return what it prints.

    Raises:
        RuntimeError: It failed; with its output.
    """
    done = subprocess.run(
        command, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))}: exit {done.returncode}\n{done.stdout[-4000:]}")
    return done.stdout


def content_hash(*parts: str | Path) -> str:
    """Return a hash of words, and of the names and contents of files and folders."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, str):
            digest.update(f"{part}\0".encode())
            continue
        for path in [part] if part.is_file() else sorted(part.rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(f"{path.relative_to(part.parent)}\0".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def made(cache: Path, name: str, key: str, make: Callable[[Path], None]) -> Path:
    """Return the folder of this name and key, made if it is not there; older ones of the name are deleted.

    Only one process at a time makes anything in a cache, so that what is half made was left by one that is gone.
    """
    folder = cache / f"{name}-{key}"
    cache.mkdir(parents=True, exist_ok=True)
    with (cache / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            print(f"making {folder}", flush=True)
            for old in cache.glob(f"{name}-*"):
                shutil.rmtree(old)
            partial = cache / f"{name}-{key}.partial"
            partial.mkdir()
            make(partial)
            partial.rename(folder)
    return folder


def install_missing(packages: Sequence[str]) -> None:
    """Install the Debian packages that are not installed.

    Raises:
        LackingError: This computer cannot; with the reason.
    """
    if not (shutil.which("dpkg-query") and shutil.which("apt-get")):
        raise LackingError("there is no apt-get")
    asked = subprocess.run(
        ["dpkg-query", "--show", "--showformat", "${db:Status-Status} ${Package}\n", *packages],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    installed = {line.split()[1] for line in asked.stdout.splitlines() if line.startswith("installed ")}
    missing = [name for name in packages if name not in installed]
    if not missing:
        return
    if os.geteuid() != 0:
        raise LackingError(f"it needs root, to install {' '.join(missing)}")
    print(f"installing {' '.join(missing)}", flush=True)
    environment = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    for command in (["update"], ["install", "--yes", "--no-install-recommends", *missing]):
        done = subprocess.run(
            ["apt-get", "--quiet=2", "-o", "DPkg::Lock::Timeout=120", *command],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            last = (done.stderr or done.stdout).strip().splitlines()[-1]
            raise LackingError(f"apt-get {command[0]} failed: {last}")
