"""The RESET line: how it is requested and pulsed, and the messages without one."""

import errno
import os
from typing import TYPE_CHECKING, cast

import pytest
from gpiod.line import Direction, Drive, Value

from footsense.acquisition.gpio import SETTINGS, LinuxResetLine
from footsense.errors import HardwareError

if TYPE_CHECKING:
    import gpiod


class Line:
    """A requested line that keeps the values it was set to."""

    def __init__(self, error: OSError | None = None) -> None:
        self.values: list[tuple[int, Value]] = []
        self.released = False
        self._error = error

    def set_value(self, line: int, value: Value) -> None:
        if self._error:
            raise self._error
        self.values.append((line, value))

    def release(self) -> None:
        self.released = True


def reset_line(line: Line) -> LinuxResetLine:
    return LinuxResetLine(cast("gpiod.LineRequest", line), "/dev/gpiochip0", 17)


def test_the_line_is_an_open_drain_active_low_output_that_is_released() -> None:
    """Driven high, the pin would fight a mux with a lower supply; active at once, it would reset the bus."""
    assert (SETTINGS.direction, SETTINGS.drive) == (Direction.OUTPUT, Drive.OPEN_DRAIN)
    assert (SETTINGS.active_low, SETTINGS.output_value) == (True, Value.INACTIVE)


def test_a_pulse_is_active_then_inactive() -> None:
    """The pin is low for two system calls, and the line stays requested until it is closed."""
    line = Line()
    reset = reset_line(line)
    reset.pulse()
    assert line.values == [(17, Value.ACTIVE), (17, Value.INACTIVE)]
    assert not line.released
    reset.close()
    assert line.released


def test_a_line_that_has_gone_is_one_line_and_is_requested_again(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loop goes on without it; the journal has one line however often the bus is stuck; a new line is pulsed."""
    lost = Line(OSError(errno.ENODEV, os.strerror(errno.ENODEV)))
    reset = reset_line(lost)
    back = Line()
    answers: list[Line | OSError] = [OSError(errno.ENOENT, "No such file or directory"), back]

    def request(*_: object, **__: object) -> Line:
        answer = answers.pop(0)
        if isinstance(answer, OSError):
            raise answer
        return answer

    monkeypatch.setattr("gpiod.request_lines", request)
    reset.pulse()
    assert lost.released
    reset.pulse()
    assert [record.getMessage() for record in caplog.records] == [
        "/dev/gpiochip0 line 17: No such device; a leg that holds its bus low stops the others until it is back"
    ]
    reset.pulse()
    assert back.values == [(17, Value.ACTIVE), (17, Value.INACTIVE)]


def test_a_chip_that_is_not_there_is_one_clear_line() -> None:
    """The message names the line and the command that lists lines."""
    with pytest.raises(
        HardwareError, match=r"^/dev/gpiochip99 line 3: No such file or directory; see `gpioinfo`"
    ):
        LinuxResetLine.open("/dev/gpiochip99", 3)


def test_another_kind_of_file_is_no_chip() -> None:
    """The message says so."""
    with pytest.raises(HardwareError, match=r"^/dev/null line 3: (No such device|Inappropriate ioctl)"):
        LinuxResetLine.open("/dev/null", 3)
