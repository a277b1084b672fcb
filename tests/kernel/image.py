"""The disk image, kernel and initial RAM disk of the machine, each made once for what goes into it.

    packages.tar       Debian, with systemd and the packages of deploy/README.md    mmdebstrap
    wheels/            the packages of deploy/requirements.lock                     pip download
    modules/           the adapter without hardware, the kernel's multiplexer       the kernel's headers and source
    disk.img           all of that, and footsense installed by section 1 of deploy/README.md

Each has a folder of its own under build/kernel, whose name ends in the hash of its content.
"""

import shutil
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from tests.kernel import deploy_page
from tests.support.made_once import LackingError, content_hash, fetch, made, run

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent
CACHE = ROOT / "build" / "kernel"

#: Debian packages of the computer that makes and emulates the machine.
HOST_PACKAGES = (
    "qemu-system-x86",
    "linux-image-amd64",
    "linux-headers-amd64",
    "linux-source-6.1",
    "mmdebstrap",
    "e2fsprogs",
    "cpio",
    "gcc",
    "make",
    "kmod",
    "busybox-static",
)
_GUEST_PACKAGES = (
    "systemd",
    "systemd-sysv",
    "udev",
    "dbus",
    "python3",
    "iproute2",
    "kmod",
    "procps",
    "strace",
)
_SUITE = "bookworm"
#: The driver of a TCA9548A, which Debian does not build for x86-64.
_SOURCE = Path("/usr/src/linux-source-6.1.tar.xz")
_MUX_DRIVER = "linux-source-6.1/drivers/i2c/muxes/i2c-mux-pca954x.c"
#: What pip needs of the checkout, and the folder that the page is about.
_CHECKOUT = ("footsense", "firmware_interface", "models", "deploy", "pyproject.toml", "README.md", "LICENSE")
#: Modules of the kernel package that this machine has no use for.
_NOT_COPIED = (
    "drivers/gpu",
    "drivers/iio",
    "drivers/infiniband",
    "drivers/media",
    "drivers/net/ethernet",
    "drivers/net/wireless",
    "drivers/scsi",
    "drivers/staging",
    "sound",
)
_BOOT_MODULES = ("nfit", "nd_pmem", "crc32c_generic", "ext4")


class Image(NamedTuple):
    """Files to boot.

    Attributes:
        disk: Disk image.
        kernel: Linux.
        initrd: Initial RAM disk.
    """

    disk: Path
    kernel: Path
    initrd: Path


def kernel_version() -> str:
    """Return the newest version of the kernel whose image and headers are installed.

    Raises:
        LackingError: There is none.
    """
    versions = [
        path.name
        for path in Path("/lib/modules").glob("*-amd64")
        if (path / "build").exists() and Path(f"/boot/vmlinuz-{path.name}").exists()
    ]
    if not versions:
        raise LackingError("there is no kernel with its headers under /lib/modules and /boot")
    return max(versions, key=lambda name: [int(part) for part in name.split("-")[0].split(".")])


def packages() -> Path:
    """Return the archive of Debian with all packages."""
    names = sorted({*_GUEST_PACKAGES, *deploy_page.packages()})

    def make(folder: Path) -> None:
        target = folder / "packages.tar"
        include = f"--include={','.join(names)}"
        fetch("mmdebstrap", "--mode=root", "--variant=minbase", include, _SUITE, target)

    return made(CACHE, "packages", content_hash(_SUITE, *names), make) / "packages.tar"


def wheels() -> Path:
    """Return the folder of the packages that the page installs, without footsense."""
    lock = ROOT / "deploy" / "requirements.lock"

    def make(folder: Path) -> None:
        download = (sys.executable, "-m", "pip", "download", "--quiet", "--no-deps")
        fetch(*download, "--dest", folder, "--requirement", lock)

    return made(CACHE, "wheels", content_hash(lock), make)


def modules(kernel: str) -> Path:
    """Return the folder of our kernel modules, and of the kernel's driver of a multiplexer."""

    def make(folder: Path) -> None:
        shutil.copytree(HERE / "modules", folder, dirs_exist_ok=True)
        run("tar", "-C", folder, "--strip-components=4", "--occurrence=1", "-xf", _SOURCE, _MUX_DRIVER)
        run("make", "-C", f"/lib/modules/{kernel}/build", f"M={folder}", "modules")
        run("strip", "--strip-debug", *folder.glob("*.ko"))

    return made(CACHE, "modules", content_hash(kernel, HERE / "modules"), make)


def image() -> Image:
    """Return the machine, made from what is cached and what has changed."""
    kernel = kernel_version()
    parts = (packages(), wheels(), modules(kernel))
    checkout = [ROOT / name for name in _CHECKOUT]
    key = content_hash(kernel, *(part.parent.name for part in parts[:1]), *(part.name for part in parts[1:]),
                Path(__file__), HERE / "guest", *checkout)  # fmt: skip

    def make(folder: Path) -> None:
        root = folder / "root"
        _unpack(root, parts[0], kernel, parts[2])
        _place_guest_files(root)
        _install_as_the_page_says(root, parts[1])
        run("mke2fs", "-q", "-t", "ext4", "-d", root, folder / "disk.img", "3G")
        shutil.rmtree(root)
        _make_initrd(folder, kernel, parts[2] / "slow_clock.ko")
        shutil.copy(f"/boot/vmlinuz-{kernel}", folder / "vmlinuz")

    folder = made(CACHE, "image", key, make)
    return Image(folder / "disk.img", folder / "vmlinuz", folder / "initrd.gz")


def _unpack(root: Path, archive: Path, kernel: str, ours: Path) -> None:
    """Unpack Debian, and add the modules of the kernel and ours."""
    root.mkdir()
    run("tar", "-C", root, "-xf", archive)
    source, target = Path("/lib/modules") / kernel, root / "lib/modules" / kernel
    left_out = {source / "kernel" / name for name in _NOT_COPIED} | {source / "build", source / "source"}

    def ignored(folder: str, names: Iterable[str]) -> list[str]:
        return [name for name in names if Path(folder) / name in left_out]

    shutil.copytree(source, target, ignore=ignored, symlinks=True)
    (target / "extra").mkdir()
    for module in ours.glob("*.ko"):
        shutil.copy(module, target / "extra")
    run("depmod", "-b", root, kernel)


def _place_guest_files(root: Path) -> None:
    """Add what makes this a machine with feet, an adapter and CAN: nothing that deploy/README.md is about."""
    library, units = root / "usr/local/lib", root / "etc/systemd/system"
    for program in ("agent.py", "chip_server.py"):
        shutil.copy(HERE / "guest" / program, library)
    for unit, target in (("agent", "multi-user"), ("candump", "multi-user"), ("chips", "basic")):
        wanted = units / f"{target}.target.wants"
        wanted.mkdir(parents=True, exist_ok=True)
        shutil.copy(HERE / "guest" / f"{unit}.service", units)
        (wanted / f"{unit}.service").symlink_to(f"../{unit}.service")
    for name, text in {
        "etc/hostname": "robot\n",
        "etc/hosts": "127.0.0.1 localhost robot\n",
        "etc/fstab": "/dev/pmem0 / ext4 defaults 0 1\n",
        "etc/modules-load.d/machine.conf": "virtio_console\nfeet_adapter\n",
        "etc/systemd/network/70-can0.netdev": "[NetDev]\nName=can0\nKind=vcan\n",
    }.items():
        (root / name).write_text(text, encoding="utf-8")
    (root / "var/log/journal").mkdir(parents=True, exist_ok=True)
    (units / "e2scrub_reap.service").symlink_to("/dev/null")  # for LVM; 25 s of every boot


def _install_as_the_page_says(root: Path, wheels_folder: Path) -> None:
    """Execute section 1 of deploy/README.md in the folder `deploy` of a checkout, as root of the machine.

    Packages are there, and pip finds wheels in a folder: the machine has no network.
    """
    checkout = root / "root" / "footsense"
    for name in _CHECKOUT:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, checkout / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, checkout / name)
    (root / "wheels").mkdir()
    lines = "\n".join(f"{command.before}\n{command.text}" for command in deploy_page.section(1))
    (root / "install.sh").write_text(f"set -ex\ncd /root/footsense/deploy\n{lines}\n", encoding="utf-8")
    inside = "env -i HOME=/root LANG=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin ORT_DISABLE_TELEMETRY=1 PIP_NO_INDEX=1"
    run(
        "unshare",
        "--mount",
        "--propagation=private",
        "bash",
        "-ec",
        f"mount -t proc proc {root}/proc; mount -t sysfs sys {root}/sys; mount --rbind /dev {root}/dev\n"
        f"mount --bind {wheels_folder} {root}/wheels\n"
        f"{inside} PIP_FIND_LINKS=/wheels chroot {root} bash /install.sh",
    )
    (root / "install.sh").unlink()
    (root / "wheels").rmdir()


def _make_initrd(folder: Path, kernel: str, first: Path) -> None:
    """Make the initial RAM disk: busybox, a script, a module that is first, and those that a disk needs."""
    tree = folder / "initrd"
    for name in ("bin", "proc", "sys", "dev", "root", "modules"):
        (tree / name).mkdir(parents=True)
    shutil.copy("/bin/busybox", tree / "bin")
    shutil.copy(HERE / "guest" / "init", tree / "init")
    shutil.copy(first, tree / "modules")
    listed = [first.name]
    for module in _BOOT_MODULES:
        for line in run("modprobe", "-S", kernel, "--show-depends", module).splitlines():
            kind, _, path = line.partition(" ")
            if kind == "insmod" and Path(path.strip()).name not in listed:
                shutil.copy(path.strip(), tree / "modules")
                listed.append(Path(path.strip()).name)
    (tree / "modules" / "list").write_text("".join(f"{name}\n" for name in listed), encoding="utf-8")
    run("bash", "-ec", f"find . | cpio -o -H newc --quiet | gzip -1 > {folder}/initrd.gz", cwd=tree)
    shutil.rmtree(tree)
