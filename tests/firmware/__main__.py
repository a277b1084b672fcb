"""`make firmware`: builds the reference firmware of board `mcu` for each port, tests it, and tells what it takes.

The fault table of the service's own scanner runs twice: with the firmware in the process of the tests, where memory and
arithmetic are checked, and on an emulated Cortex-M. Without the tools a line says which are missing.
"""

import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from firmware_interface.mcu.uf2 import uf2
from footsense.frames import Reading
from tests.contract.ad7147_robot import EMULATED, Robot
from tests.firmware.emulated import MISSING, Emulated, build, sizes

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "build/firmware"
#: Cycles of a Cortex-M0+ for an instruction of this firmware: assumed, 1 to 2.
_CYCLES_PER_INSTRUCTION, _RP2040_HZ = 1.5, 125e6
TESTS = [
    "tests/contract/test_ad7147.py",
    "tests/contract/test_ad7147_kinds.py",
    "tests/firmware",
]
RP2040JS = "rp2040js@1.4.1"


def run_table(which: str, **environment: str) -> None:
    """Run the fault table with one of the ways to run the firmware; end if a test fails."""
    command = [sys.executable, "-m", "pytest", "-q", "-n", "auto", "-m", "not slow", "-k", which, *TESTS]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | environment, check=False)
    if done.returncode:
        sys.exit(done.returncode)


def sanitizers() -> str | None:
    """Return the library that has to be loaded before Python, for the checks of memory; None without it."""
    try:
        found = subprocess.check_output(["cc", "-print-file-name=libasan.so"], text=True).strip()
    except (OSError, subprocess.CalledProcessError):
        return None
    return found if Path(found).is_file() else None


def build_rp2040() -> Path:
    """Build the firmware of an RP2040; return the file that its boot loader takes."""
    program, image = build("rp2040", FOLDER), FOLDER / "rp2040.bin"
    subprocess.run(["arm-none-eabi-objcopy", "-O", "binary", str(program), str(image)], check=True)
    file = FOLDER / "footsense-rp2040.uf2"
    file.write_bytes(uf2(image.read_bytes()))
    return file


def install_emulator() -> None:
    """Install the emulator of an RP2040, a package of npm, if that is here."""
    npm = ["npm", "install", "--silent", "--no-audit", "--no-fund", "--prefix", str(FOLDER), RP2040JS]
    if shutil.which("npm") is None or subprocess.run(npm, check=False).returncode:
        print(f"no npm, or no {RP2040JS}: the port for the RP2040 is built, and not run")


def print_costs() -> None:
    """Print flash, RAM, stack, instructions and transactions of a scan, through a broken cable and back."""
    logging.disable()  # the service's lines of that cable
    robot = Robot(EMULATED)
    firmware = robot.line.scan
    assert isinstance(firmware, Emulated)
    robot.read_for(0.5)
    instructions = np.array([spent.instructions for spent in firmware.spent[1:]])
    n_before = robot.board.n_transfers
    frames = robot.read_for(1.0)
    assert all((reading == Reading.OK).all() for _, reading, _ in frames)
    per_scan = (robot.board.n_transfers - n_before) / len(frames)
    now_ns = robot.clock.now_ns()
    robot.chips[3].absent_ns = [(now_ns, now_ns + 200_000_000)]
    robot.read_for(1.0)
    settled = np.array([spent.instructions for spent in firmware.spent[-100:]])
    rows = [
        ("flash, RAM without the stack, RP2040 [bytes]", "{}, {}".format(*sizes(FOLDER / "rp2040.elf"))),
        ("deepest stack, emulated [bytes]", f"{firmware.spent[-1].stack_bytes}"),
        ("instructions of a scan of six legs, without the port", f"{settled.mean():.0f}"),
        ("the same, most, while legs are set up", f"{instructions.max():.0f}"),
        ("transactions of a scan, each with all legs at once", f"{per_scan:.1f}"),
    ]
    for what, figure in rows:
        print(f"{what:56} {figure}")


def main() -> None:
    """Build, test and measure."""
    if MISSING:
        packages = "gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm of Debian"
        print(f"the firmware is not built here: no {MISSING}; install {packages}")
        return
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = build_rp2040()
    print(file.relative_to(ROOT))
    if (library := sanitizers()) is None:
        print("no AddressSanitizer here: the firmware is tested without")
    else:
        run_table("mcu", FOOTSENSE_SANITIZE="1", LD_PRELOAD=library, ASAN_OPTIONS="detect_leaks=0")
    install_emulator()
    run_table("emulated or rp2040", FOOTSENSE_EMULATED="1")
    print_costs()


if __name__ == "__main__":
    main()
