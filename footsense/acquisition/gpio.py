"""One line of a Linux GPIO chip as a mux's RESET pin, through the character device (linux/gpio.h, version 2).

The line is requested as an open-drain, active-low output: it is let go at rest, so that the mux's own pull-up keeps the
pin high, whatever supply the mux has.
"""

import fcntl
import os
import struct

from footsense.errors import HardwareError

#: struct gpio_v2_line_request: offsets[64], consumer, config (flags, n attributes, padding, 10 attributes of 24 bytes),
#: n lines, event buffer size, padding, file descriptor.
_REQUEST = struct.Struct("=64I 32s Q I 20x 240x I I 20x i")
#: struct gpio_v2_line_values: bits, mask.
_VALUES = struct.Struct("=QQ")
#: _IOWR(0xB4, number, struct).
_GET_LINE = 0xC000_0000 | _REQUEST.size << 16 | 0xB4 << 8 | 0x07
_SET_VALUES = 0xC000_0000 | _VALUES.size << 16 | 0xB4 << 8 | 0x0F
_ACTIVE_LOW, _OUTPUT, _OPEN_DRAIN = 1 << 1, 1 << 3, 1 << 6


def request(line: int) -> bytes:
    """Return what asks the kernel for one line, not active."""
    offsets = (line, *[0] * 63)
    return _REQUEST.pack(*offsets, b"footsense", _ACTIVE_LOW | _OUTPUT | _OPEN_DRAIN, 0, 1, 0, 0)


class LinuxResetLine:
    """A line that is pulled low for a moment.

    Args:
        descriptor: File descriptor of the requested line.
        name: What it is, for messages.
    """

    def __init__(self, descriptor: int, name: str) -> None:
        self._descriptor = descriptor
        self._name = name

    @classmethod
    def open(cls, device: str, line: int) -> "LinuxResetLine":
        """Request a line.

        Args:
            device: The GPIO chip, such as /dev/gpiochip0.
            line: Number of the line on it.

        Raises:
            HardwareError: There is no such chip or line, it is in use, or this user may not use it.
        """
        name = f"{device} line {line}"
        asked = bytearray(request(line))
        try:
            chip = os.open(device, os.O_RDONLY | os.O_CLOEXEC)
            try:
                fcntl.ioctl(chip, _GET_LINE, asked)
            finally:
                os.close(chip)
        except OSError as error:
            raise HardwareError(
                f"{name}: {error.strerror}; see `gpioinfo`, and the service's user belongs in group gpio"
            ) from error
        return cls(int(_REQUEST.unpack(asked)[-1]), name)

    def pulse(self) -> None:
        """Pull the line low and let it go.

        A system call takes a thousand times longer than the 6 ns that a TCA9548A asks for.

        Raises:
            HardwareError: The line is gone.
        """
        try:
            for active in (1, 0):
                fcntl.ioctl(self._descriptor, _SET_VALUES, _VALUES.pack(active, 1))
        except OSError as error:
            raise HardwareError(f"{self._name}: {error.strerror}") from error

    def close(self) -> None:
        """Let the line go."""
        os.close(self._descriptor)
