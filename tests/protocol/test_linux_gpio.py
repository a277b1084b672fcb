"""The bytes that ask the kernel for a RESET line, pinned to linux/gpio.h, and what is said where there is none."""

import pytest

from footsense.acquisition.gpio import LinuxResetLine, request
from footsense.errors import HardwareError


def test_one_line_is_asked_for_as_an_open_drain_active_low_output() -> None:
    """The struct gpio_v2_line_request has 592 bytes: offsets, consumer at 256, flags at 288, number of lines at 560."""
    asked = request(17)
    assert len(asked) == 592
    assert asked[:4] == b"\x11\x00\x00\x00"
    assert asked[256:288].rstrip(b"\x00") == b"footsense"
    assert asked[288:296] == (0b1001010).to_bytes(8, "little")
    assert asked[560:564] == b"\x01\x00\x00\x00"
    assert not any(asked[4:256] + asked[296:560] + asked[564:])


def test_a_chip_that_is_not_there_is_one_clear_line() -> None:
    """The message names the line and what to look at."""
    with pytest.raises(
        HardwareError, match=r"^/dev/gpiochip99 line 3: No such file or directory; see `gpioinfo`"
    ):
        LinuxResetLine.open("/dev/gpiochip99", 3)


def test_another_kind_of_file_is_no_chip() -> None:
    """The message says so."""
    with pytest.raises(HardwareError, match=r"^/dev/null line 3: Inappropriate ioctl for device"):
        LinuxResetLine.open("/dev/null", 3)
