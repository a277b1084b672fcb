"""What an emulated aarch64 computer boots: a kernel, and two RAM disks that Linux unpacks over each other.

    vmlinuz, root.cpio    Debian's kernel and Python, the packages of the robot's lock and pytest: made once and cached
    checkout.cpio         this checkout, and the client in C; anew for each run

The cache is outside the checkout, so that one that is freshly cloned finds it. No program of aarch64 is executed here:
Debian's packages are unpacked, wheels are for its platform, and the bytecode is that of any Python 3.11.
"""

import os
import re
import shutil
import sys
from contextlib import chdir
from pathlib import Path

import pytest

from tests.contract.c_decoder import build_library
from tests.support.made_once import LackingError, content_hash, fetch, made, run

ROOT = Path(__file__).parents[2]
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "footsense"
#: Debian packages of the computer that makes and emulates the machine.
HOST_PACKAGES = ("qemu-system-arm", "mmdebstrap", "cpio")

_SUITE = "bookworm"
_GUEST_PACKAGES = ("linux-image-arm64", "busybox-static", "python3", "libstdc++6")
#: Of them, what no check needs.
_LEFT_OUT = ("boot/System*", "dev", "lib/modules", "usr/lib/linux-image*", "usr/share")
_LOCKS = tuple(ROOT / name / "requirements.lock" for name in ("deploy", "tests"))
_TEST_PACKAGES = ("hypothesis", "pytest", "pytest-timeout")
_SITE_PACKAGES = "usr/local/lib/python3.11/dist-packages"
_CHECKOUT = ("firmware_interface", "footsense", "models", "tests", "pyproject.toml")
_INIT = Path(__file__).parent / "guest" / "init"
_C_COMPILER = f"{sys.executable} -m ziglang cc -target aarch64-linux-gnu.2.36"


def root() -> Path:
    """Return the folder of the kernel and the root directory."""
    return made(CACHE, "aarch64", content_hash(Path(__file__), *_LOCKS), _make_root)


def _make_root(folder: Path) -> None:
    """Make the kernel and the root directory.

    Raises:
        LackingError: There is no network.
    """
    tree, archive = folder / "root", folder / "debian.tar"
    tree.mkdir()
    include = f"--include={','.join(_GUEST_PACKAGES)}"
    fetch("mmdebstrap", "--quiet", "--architectures=arm64", "--variant=extract", include, _SUITE, archive)
    run("tar", "-C", tree, "-xf", archive, *(f"--exclude=./{name}" for name in _LEFT_OUT))
    archive.unlink()
    (kernel,) = (tree / "boot").glob("vmlinuz-*")
    kernel.rename(folder / "vmlinuz")
    # Constraints have the hashes of the packages that are named.
    pins = re.findall(rf"^(?:{'|'.join(_TEST_PACKAGES)})==[^\s;]+", _LOCKS[1].read_text(), re.MULTILINE)
    try:
        run(
            Path(sys.executable).with_name("uv"), "pip", "install", "--quiet", "--require-hashes",
            "--python", sys.executable, "--python-version", "3.11", "--python-platform", "aarch64-manylinux_2_28",
            "--target", tree / _SITE_PACKAGES, "-r", _LOCKS[0], "-c", _LOCKS[1], *pins,
        )  # fmt: skip
    except RuntimeError as error:
        # A wrong hash, or a package without a wheel for this processor, is what the check has to find.
        if "Failed to fetch" not in str(error):
            raise
        raise LackingError("uv cannot fetch the packages") from error
    _archive(tree, folder / "root.cpio")


def checkout(folder: Path) -> Path:
    """Return a RAM disk of this checkout and of the client in C."""
    tree = folder / "checkout"
    for name in _CHECKOUT:
        target = tree / "footsense" / name
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, target)
    shutil.copy(_INIT, tree / "init")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", _C_COMPILER)
        (folder / "c").mkdir()
        shutil.copy(build_library(folder / "c"), tree / "footsense.so")
    _archive(tree, folder / "checkout.cpio")
    return folder / "checkout.cpio"


def _archive(tree: Path, target: Path) -> None:
    """Compile all Python of a folder, as it takes long in an emulator; then put it into an archive."""
    compile_all = (
        sys.executable,
        "-m",
        "compileall",
        "-q",
        "-j",
        "0",
        "--invalidation-mode",
        "unchecked-hash",
    )
    with chdir(tree):
        # Examples of syntax errors among Python's own tests do not matter.
        run("sh", "-c", '"$@" . || true', "sh", *compile_all)
    run("sh", "-c", 'find . | cpio --create --format=newc --owner=0:0 --quiet >"$0"', target, cwd=tree)
    shutil.rmtree(tree)
