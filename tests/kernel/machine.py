"""The emulated machine, with systemd as process 1.

Its clock counts instructions (`-icount`), four a nanosecond, as its only processor stands for the four of a robot's
computer; time in which none is executed is skipped (`sleep=off`). A busy host makes a trial longer, and nothing in it
later, so that the loop keeps its conversions wherever the trials run. The emulator counts one a nanosecond at most: the
kernel is told that its time stamp counter is faster (`modules/slow_clock.c`). The disk is memory (NVDIMM), because the
machine's time would run on while a disk is read. The processor has no fused multiply-add, which is slow to emulate.
qemu 7.2 counts for one processor only, and without KVM.
"""

import contextlib
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.kernel.can_stream import CanStream
from tests.kernel.image import CACHE, Image
from tests.kernel.ports import Chips, GuestError, Shell

_PORTS = ("agent", "chips", "can")
#: Longest boot [s], of the host's time.
_BOOT_S = 600.0
_JOURNAL = "journalctl -u footsense"
#: Speed of its processor.
INSTRUCTIONS_PER_NS = 4
#: Of its time stamp counter, and no timer that would be calibrated for long.
_CLOCK = f"tsc=reliable tsc_early_khz={INSTRUCTIONS_PER_NS}000000 noapictimer"
_BOOT_ID = "cat /proc/sys/kernel/random/boot_id"


class Machine:
    """A running machine.

    Attributes:
        shell: Commands in it.
        chips: The simulated chips behind its adapter.
        can: Frames on its can0.
    """

    def __init__(self, folder: Path) -> None:
        self.shell = Shell(folder / "agent")
        self.chips = Chips(folder / "chips")
        self.can = CanStream(folder / "can", lambda: self.chips.monotonic_s)
        self.shell.wait_until_up(_BOOT_S)

    def run(self, command: str, timeout_s: float = 300) -> str:
        """Return the output of a command.

        Raises:
            GuestError: It failed.
        """
        return self.shell.run(command, timeout_s)

    def reboot(self) -> None:
        """Restart the machine as its user would, and return when it answers again."""
        before = self.run(_BOOT_ID)
        self.shell.start("systemctl reboot")
        end_s = time.monotonic() + _BOOT_S
        while time.monotonic() < end_s:
            with contextlib.suppress(GuestError):  # an answer is lost while it goes down
                code, boot = self.shell.wait(self.shell.start(_BOOT_ID), 5)
                if code == 0 and boot != before:
                    return
        raise GuestError("the machine does not come back")

    def active_since_s(self, unit: str) -> float:
        """Return when a unit became active, from the start of the kernel [s]."""
        return int(self.run(f"systemctl show -P ActiveEnterTimestampMonotonic {unit}")) / 1e6

    def journal(self, since: str) -> list[str]:
        """Return the service's lines since a cursor of the journal."""
        text = self.run(f"{_JOURNAL} --no-pager -o cat --after-cursor '{since}'")
        return [line for line in text.splitlines() if line]

    @property
    def journal_cursor(self) -> str:
        """Cursor at the service's last line: at that of another unit, journalctl would leave out the next line."""
        return self.run(f"journalctl --sync; {_JOURNAL} -n 0 --show-cursor").split("-- cursor: ")[-1].strip()


@contextlib.contextmanager
def running(image: Image) -> Iterator[Machine]:
    """Boot a machine, and end it. What it writes to its disk is gone with it.

    The folder of its console is `build/kernel/machine`, with the name of the process that runs trials beside others;
    kept until the next one.
    """
    log = CACHE / f"machine{os.environ.get('PYTEST_XDIST_WORKER', '')}"
    shutil.rmtree(log, ignore_errors=True)
    log.mkdir()
    with tempfile.TemporaryDirectory(
        prefix="kernel-test-"
    ) as short_name:  # a socket's path has 107 bytes at most
        folder = Path(short_name)
        ports = [
            word
            for name in _PORTS
            for word in (
                "-chardev", f"socket,path={folder / name},server=on,wait=off,id={name}",
                "-device", f"virtserialport,chardev={name},name={name}",
            )
        ]  # fmt: skip
        qemu = subprocess.Popen([
            "qemu-system-x86_64", "-M", "q35,nvdimm=on", "-icount", "shift=0,sleep=off", "-rtc", "clock=vm",
            "-cpu", "max,fma=off", "-smp", "1", "-m", "2048,slots=1,maxmem=8G",
            "-nodefaults", "-display", "none", "-nic", "none",
            "-kernel", image.kernel, "-initrd", image.initrd,
            "-append", f"root=/dev/pmem0 rw console=ttyS0 mitigations=off audit=0 {_CLOCK}",
            "-object", f"memory-backend-file,id=disk,mem-path={image.disk},size=3G,share=off,reserve=off",
            "-device", "nvdimm,memdev=disk",
            "-device", "virtio-rng-pci", "-device", "virtio-serial-pci", *ports,
            "-serial", f"file:{log / 'console.log'}",
        ], env=os.environ | {"TMPDIR": str(CACHE)})  # fmt: skip
        try:
            while not all((folder / name).exists() for name in _PORTS):
                if qemu.poll() is not None:
                    raise GuestError(f"qemu has ended with {qemu.returncode}")
                time.sleep(0.1)
            machine = Machine(folder)
            try:
                yield machine
            finally:
                for user in (machine.can, machine.chips, machine.shell):
                    user.port.close()
        finally:
            qemu.terminate()
            qemu.wait(30)
