"""`make kernel-test`: installs what it needs from Debian, and runs the trials on an emulated machine.

    python -m tests.kernel            all trials; writes docs/report/kernel.md if they pass
    python -m tests.kernel --short    the short form

Where the machine cannot be made, one line says why; the short form then ends with 0, because CI runs it everywhere.
"""

import os
import platform
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.kernel.image import HOST_PACKAGES, ROOT, image
from tests.support.made_once import LackingError, install_missing

_SHORT = "trials_1_short.py"
#: Longest short form, without what it installs and makes before [s]; one that takes longer has failed.
_SHORT_LIMIT_S = 1200
#: Of the disk, for the cache and what the machine writes; and of the memory [GB].
_DISK_GB, _MEMORY_GB = 8, 5.0


def obstacles() -> Iterator[str]:
    """Yield why the trials cannot run here, each in a few words."""
    release = Path("/etc/os-release")
    words = dict(
        line.partition("=")[::2] for line in (release.read_text() if release.exists() else "").splitlines()
    )
    if words.get("ID") != "debian" or words.get("VERSION_ID") != '"12"':
        yield "this is not Debian 12"
    if platform.machine() != "x86_64":
        yield f"the emulated kernel is for x86-64, and this is {platform.machine()}"
    if sys.version_info[:2] != (3, 11):
        yield "wheels are made for the Python of Debian 12: make PYTHON=python3.11"
    if os.geteuid() != 0:
        yield "it needs root, to make a file system"
    elif subprocess.run(["unshare", "--mount", "true"], capture_output=True, check=False).returncode:
        yield "root may not mount here, as in a container"
    if shutil.disk_usage(ROOT).free < _DISK_GB * 1e9:
        yield f"it needs {_DISK_GB} GB of disk"
    if _available_kb() < _MEMORY_GB * 1e6:
        yield f"it needs {_MEMORY_GB} GB of memory"


def _available_kb() -> int:
    """Return the memory that programs can still have [kB]."""
    (line,) = (each for each in Path("/proc/meminfo").read_text().splitlines() if "MemAvailable" in each)
    return int(line.split()[1])


def prepare() -> None:
    """Install packages and make the image, where they are missing.

    Raises:
        LackingError: This computer cannot.
    """
    reason = next(obstacles(), None)
    if reason is not None:
        raise LackingError(reason)
    install_missing(HOST_PACKAGES)
    image()


def main() -> int:
    """Run the trials, and return the exit code."""
    short = "--short" in sys.argv[1:]
    here = Path(__file__).parent
    # All trials on two machines, which divide the files between them in their order: the first trial needs a machine as
    # it is made.
    divided = ["-n", "2", "--dist", "loadfile", "--no-loadscope-reorder"]
    targets = [str(here / _SHORT)] if short else [str(here), "--write-page", *divided]
    is_late = False

    def interrupt(*_: object) -> None:
        nonlocal is_late
        is_late = True
        raise KeyboardInterrupt  # pytest ends the machine

    try:
        signal.signal(signal.SIGALRM, interrupt)
        prepare()
        signal.alarm(_SHORT_LIMIT_S if short else 0)
        code = int(pytest.main([
            "-q", "--timeout", "0", "--rootdir", str(ROOT), "--override-ini", "python_files=trials_*.py",
            "--override-ini", "addopts=--strict-markers --strict-config --import-mode=importlib -ra", *targets,
        ]))  # fmt: skip
    except LackingError as error:
        print(f"kernel-test: not run: {error}")
        return 0 if short else 1
    except KeyboardInterrupt:
        code = pytest.ExitCode.INTERRUPTED
    if is_late:
        print(
            f"kernel-test: not run to its end: this computer takes more than {_SHORT_LIMIT_S // 60} minutes"
        )
        return 1
    return code


if __name__ == "__main__":
    sys.exit(main())
