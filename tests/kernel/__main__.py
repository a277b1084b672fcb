"""`make kernel-test`: installs what it needs from Debian, and runs the trials on an emulated machine.

    python -m tests.kernel            all trials; writes docs/report/kernel.md
    python -m tests.kernel --short    the short form

Where the machine cannot be made, one line says why; the short form then ends with 0, because CI runs it everywhere.
"""

import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

from tests.kernel.image import HOST_PACKAGES, ROOT, image

_SHORT = "trials_1_short.py"


def obstacle() -> str | None:
    """Return why the trials cannot run here, in a few words; None if they can."""
    release = Path("/etc/os-release")
    words = dict(
        line.partition("=")[::2] for line in (release.read_text() if release.exists() else "").splitlines()
    )
    if words.get("ID") != "debian" or words.get("VERSION_ID") != '"12"':
        return "this is not Debian 12"
    if platform.machine() != "x86_64":
        return f"the emulated kernel is for x86-64, and this is {platform.machine()}"
    if sys.version_info[:2] != (3, 11):
        return "wheels are made for the Python of Debian 12: make PYTHON=python3.11"
    if os.geteuid() != 0:
        return "it needs root, to make a file system"
    return None


def missing_packages() -> list[str]:
    """Return the Debian packages that are not installed."""
    asked = subprocess.run(
        ["dpkg-query", "--show", "--showformat", "${db:Status-Status} ${Package}\n", *HOST_PACKAGES],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    installed = {line.split()[1] for line in asked.stdout.splitlines() if line.startswith("installed ")}
    return [name for name in HOST_PACKAGES if name not in installed]


def install(names: list[str]) -> str | None:
    """Install Debian packages; return why that failed, None if it did not."""
    print(f"kernel-test: installing {' '.join(names)}", flush=True)
    environment = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    for command in (["update"], ["install", "--yes", "--no-install-recommends", *names]):
        done = subprocess.run(
            ["apt-get", "--quiet=2", *command], env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode:
            return f"apt-get {command[0]} failed: {(done.stderr or done.stdout).strip().splitlines()[-1]}"
    return None


def main() -> int:
    """Run the trials, and return the exit code."""
    short = "--short" in sys.argv[1:]
    reason = obstacle()
    if reason is None and (names := missing_packages()):
        reason = install(names) if shutil.which("apt-get") else "there is no apt-get"
    if reason is not None:
        print(f"kernel-test: not run: {reason}")
        return 0 if short else 1
    image()  # beforehand, so that its progress is seen
    here = Path(__file__).parent
    targets = [str(here / _SHORT)] if short else [str(here), "--write-page"]
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "--override-ini", "python_files=trials_*.py",
         "--override-ini", "addopts=--strict-markers --strict-config --import-mode=importlib -ra", *targets],
        cwd=ROOT, check=False,
    ).returncode  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
