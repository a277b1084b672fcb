"""The kernel's counter of the instructions of this thread, where the processor has one that the kernel may use."""

import ctypes
import os
import platform
import struct
from collections.abc import Callable

#: Number of the system call perf_event_open. Source: Linux, arch/x86/entry/syscalls and include/uapi/asm-generic.
_SYSCALL_NUMBERS = {"x86_64": 298, "aarch64": 241}
# linux/perf_event.h: the attributes of its first version, instructions of the hardware, in user space alone.
_ATTRIBUTES = struct.Struct("=IIQQQQQIIQ")
_TYPE_HARDWARE, _COUNT_INSTRUCTIONS = 0, 1
_EXCLUDE_KERNEL, _EXCLUDE_HYPERVISOR = 1 << 5, 1 << 6
_CLOSE_ON_EXEC = 1 << 3
_ANY_CPU, _NO_GROUP = -1, -1


def open_instruction_counter() -> Callable[[], int]:
    """Return a function that returns the instructions of this thread in user space since now.

    Raises:
        OSError: The kernel has no such counter here, or does not let this user have it.
    """
    attributes = _ATTRIBUTES.pack(
        _TYPE_HARDWARE,
        _ATTRIBUTES.size,
        _COUNT_INSTRUCTIONS,
        *(0, 0, 0),  # no samples
        _EXCLUDE_KERNEL | _EXCLUDE_HYPERVISOR,
        *(0, 0, 0),  # no wake-ups, no break-point
    )
    number = _SYSCALL_NUMBERS.get(platform.machine())
    if number is None:
        raise OSError(f"the system call of a {platform.machine()} is not known")
    libc = ctypes.CDLL(None, use_errno=True)
    fd = libc.syscall(number, attributes, 0, _ANY_CPU, _NO_GROUP, ctypes.c_ulong(_CLOSE_ON_EXEC))
    if fd < 0:
        error = ctypes.get_errno()
        raise OSError(error, os.strerror(error))
    return lambda: int.from_bytes(os.read(fd, 8), "little")


def can_count() -> bool:
    """Return whether there is such a counter."""
    try:
        open_instruction_counter()
    except OSError:
        return False
    return True
