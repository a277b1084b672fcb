"""`footsense install` in clean roots of Debian 12 and 13, by the wheel that a robot installs, with their own systemd.

It needs root and mmdebstrap, and the network the first time; the roots are cached as those of an emulated aarch64.
"""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.aarch64.root import CACHE
from tests.packaging.release import CLIENT, ROOT, build
from tests.support.made_once import LackingError, content_hash, fetch, made, run

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        os.geteuid() != 0 or not shutil.which("mmdebstrap"), reason="no root, or no mmdebstrap"
    ),
]

#: Python of each release of Debian.
PYTHONS = {"bookworm": "3.11", "trixie": "3.13"}
_PACKAGES = ("systemd", "systemd-sysv", "udev", "python3-venv", "kmod")
_LOCK = ROOT / "deploy/requirements.lock"
#: Files of users and groups, which a removal leaves.
_ACCOUNTS = re.compile(r"(passwd|shadow|group|gshadow|subuid|subgid|\.pwd\.lock)-?")


def debian(suite: str) -> Path:
    """Return an archive of a minimal Debian with systemd."""

    def make(folder: Path) -> None:
        options = ("--quiet", "--mode=root", "--variant=minbase", f"--include={','.join(_PACKAGES)}")
        fetch("mmdebstrap", *options, suite, folder / "root.tar")

    return made(CACHE, f"debian-{suite}", content_hash(suite, *_PACKAGES), make) / "root.tar"


def wheels(suite: str) -> Path:
    """Return the folder of the robot's packages."""

    def make(folder: Path) -> None:
        # pip judges markers by its own Python.
        pins = map(Requirement, re.findall(r"^[\w-]+==[^\\\n]+", _LOCK.read_text(), re.MULTILINE))
        here = {"python_version": PYTHONS[suite], "python_full_version": f"{PYTHONS[suite]}.0"}
        names = [f"{pin.name}{pin.specifier}" for pin in pins if not pin.marker or pin.marker.evaluate(here)]
        version = ("--only-binary=:all:", "--python-version", PYTHONS[suite])
        fetch(
            sys.executable,
            "-m",
            "pip",
            "download",
            "--quiet",
            "--no-deps",
            *version,
            "--dest",
            folder,
            *names,
        )

    return made(CACHE, f"wheels-{suite}", content_hash(suite, _LOCK), make)


class Robot:
    """A root directory with footsense in /opt/footsense, and commands in it."""

    def __init__(self, suite: str, root: Path, built: Sequence[Path]) -> None:
        self.root, self.suite = root, suite
        run("tar", "-C", root, "-xf", debian(suite))
        (root / "wheels").mkdir()
        for wheel in built:
            shutil.copy(wheel, root / "root")
        shutil.copy(_LOCK, root / "root")
        pip = "/opt/footsense/bin/pip install --quiet --no-index --find-links /wheels"
        self.run(
            "python3 -m venv /opt/footsense\n"
            f"{pip} --require-hashes -r /root/requirements.lock\n"
            f"{pip} --no-deps /root/*.whl"
        )

    def run(self, script: str) -> str:
        """Return what a script prints in this root, as on a computer whose systemd does not run."""
        inside = "env -i HOME=/root LANG=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin ORT_DISABLE_TELEMETRY=1"
        return run(
            *("unshare", "--mount", "--propagation=private", "bash", "-ec"),
            f"mount -t proc proc {self.root}/proc; mount --rbind /dev {self.root}/dev\n"
            f"mount --bind {wheels(self.suite)} {self.root}/wheels\n"
            f'{inside} chroot {self.root} bash -ec "$1"',
            "-",
            script,
        )

    def install(self, options: str = "") -> list[str]:
        """Return the lines of `footsense install`."""
        return self.run(f"/opt/footsense/bin/footsense install {options}").splitlines()

    @property
    def etc(self) -> dict[str, str]:
        """Content of files and targets of links under /etc, without users and groups."""
        etc = self.root / "etc"
        return {
            str(path.relative_to(etc)): str(path.readlink())
            if path.is_symlink()
            else path.read_text("latin-1")
            for path in sorted(etc.rglob("*"))
            if (path.is_symlink() or path.is_file()) and not _ACCOUNTS.fullmatch(path.name)
        }


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("wheel")
    return [build("wheel", folder), build("wheel", folder, CLIENT)]


@pytest.mark.parametrize("suite", PYTHONS)
def test_install_upgrade_and_remove(tmp_path: Path, built: list[Path], suite: str) -> None:
    """The release's systemd knows every line; its user may use I2C and run footsense; a removal leaves nothing."""
    try:
        robot = Robot(suite, tmp_path, built)
    except LackingError as lacking:
        pytest.skip(str(lacking))
    before = robot.etc
    planned = robot.install("--dry-run")
    assert robot.etc == before
    assert robot.install()[:-3] == planned[:-3]
    assert "i2c" in robot.run("id -nG footsense").split()
    robot.run("sha256sum --check --strict --quiet /etc/footsense/installed")
    networkd, waits = robot.run(
        "systemctl is-enabled systemd-networkd systemd-networkd-wait-online || true"
    ).split()
    assert (networkd, waits) == ("enabled", "disabled")
    services = [path.name for path in sorted((tmp_path / "etc/systemd/system").glob("footsense*.service"))]
    assert len(services) == 6
    robot.run(f"systemctl enable {' '.join(services)}")
    complaints = robot.run(f"systemd-analyze verify --man=no {' '.join(services)} 2>&1 || true")
    assert [line for line in complaints.splitlines() if "footsense" in line] == []
    if suite != "bookworm":  # whose udevadm cannot
        robot.run("udevadm verify /etc/udev/rules.d/99-footsense-i2c.rules")
    walk = "run --duration 1 --summary json"
    robot.run(
        f"cd /tmp; setpriv --reuid footsense --regid footsense --init-groups /opt/footsense/bin/footsense {walk}"
    )
    assert robot.install()[0] == "nothing to do"

    (unit,) = tmp_path.glob("opt/footsense/lib/python*/site-packages/footsense/deploy/footsense.service")
    unit.write_text(unit.read_text() + "# of the next version\n")
    assert "write /etc/systemd/system/footsense.service" in robot.install()
    assert robot.etc["systemd/system/footsense.service"] == unit.read_text()

    robot.install("--remove")
    assert robot.etc == before
    assert robot.install("--remove")[0] == "nothing to do"

    from_outside = [sys.executable, "-m", "footsense", "install", "--root", str(tmp_path)]
    subprocess.run(from_outside, check=True, capture_output=True)
    robot.run("sha256sum --check --strict --quiet /etc/footsense/installed")
    subprocess.run([*from_outside, "--remove"], check=True, capture_output=True)
    assert robot.etc == before
