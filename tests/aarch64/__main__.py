"""`make aarch64-test`: the robot's packages, and what has to be the same on its processor, on an emulated aarch64.

Debian's kernel for it boots in qemu, where the packages of the robot's lock replay both golden recordings, the client
in C answers to all link vectors, and the ring's tests are done. Where the machine cannot be made, or is too slow, one
line says so, and the exit code is 0, because CI runs it everywhere.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Timer

from tests.aarch64.root import HOST_PACKAGES, checkout, root
from tests.support.made_once import LackingError, install_missing

#: Names of the checks that guest/init runs, and what they are.
_CHECKS = {
    "measured_walk": "golden recording",
    "small_board": "golden recording of the smaller board",
    "tests": "client in C with its vectors, ring",
}
#: Longest run of the machine [s]; a Raspberry Pi 5 has a Cortex-A76.
_LIMIT_S, _PROCESSOR = 440, "cortex-a76"
_RESULT = re.compile(r"(\w+): exit (\d+) after (\d+) s")


def console(kernel: Path, *ram_disks: Path) -> tuple[list[str], bool]:
    """Run the machine until it is switched off or its time is over; return its console's lines, and if it was late."""
    with TemporaryDirectory(prefix="aarch64-test-") as folder:
        initrd = Path(folder) / "initrd"
        with initrd.open("wb") as file:
            for ram_disk in ram_disks:
                file.write(ram_disk.read_bytes())
        qemu = subprocess.Popen([
            "qemu-system-aarch64", "-M", "virt", "-cpu", _PROCESSOR, "-smp", str(min(4, os.cpu_count() or 1)),
            "-m", "2048", "-accel", "tcg,thread=multi", "-nodefaults", "-display", "none", "-nic", "none",
            "-no-reboot", "-serial", "stdio", "-kernel", kernel, "-initrd", initrd,
            "-append", "console=ttyAMA0 loglevel=4 panic=-1 mitigations=off",
        ], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, errors="replace")  # fmt: skip
        timer = Timer(_LIMIT_S, qemu.kill)
        timer.start()
        lines = []
        with qemu:
            assert qemu.stdout is not None
            for line in qemu.stdout:
                lines.append(line.rstrip())
                print(lines[-1], flush=True)
        late = not timer.is_alive()
        timer.cancel()
        return lines, late


def main() -> int:
    """Make what is missing, run the checks, and return the exit code."""
    try:
        install_missing(HOST_PACKAGES)
        folder = root()
    except LackingError as error:
        print(f"aarch64-test: not run: {error}")
        return 0
    with TemporaryDirectory(prefix="aarch64-test-") as work:
        lines, late = console(folder / "vmlinuz", folder / "root.cpio", checkout(Path(work)))
    results = {match[1]: match for line in lines if (match := _RESULT.fullmatch(line))}
    for name, words in _CHECKS.items():
        match = results.get(name)
        done = "not ended" if match is None else f"{'FAILED' if match[2] != '0' else 'passed'}, {match[3]} s"
        print(f"aarch64-test: {name} ({words}): {done}")
    if any(match[2] != "0" for match in results.values()):
        return 1
    if late and any(line.startswith("Linux ") for line in lines):
        print(f"aarch64-test: not run to its end: this computer takes more than {_LIMIT_S} s")
        return 0
    return 0 if len(results) == len(_CHECKS) else 1


if __name__ == "__main__":
    sys.exit(main())
