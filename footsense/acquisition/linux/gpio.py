"""One line of a Linux GPIO chip as a mux's RESET pin; the only module that imports gpiod.

The line is requested as an open-drain, active-low output: inactive it is released, so that the mux's own pull-up keeps
the pin high, whatever the mux's supply is.
"""

import gpiod
from gpiod.line import Direction, Drive, Value

from footsense.errors import HardwareError

SETTINGS = gpiod.LineSettings(
    direction=Direction.OUTPUT, drive=Drive.OPEN_DRAIN, active_low=True, output_value=Value.INACTIVE
)


class LinuxResetLine:
    """The RESET pin of a mux on a GPIO line.

    Args:
        request: The line, requested and inactive.
        device: The GPIO chip, for messages.
        line: Number of the line on it.
    """

    def __init__(self, request: gpiod.LineRequest, device: str, line: int) -> None:
        self._request = request
        self._device = device
        self._line = line

    @classmethod
    def open(cls, device: str, line: int) -> "LinuxResetLine":
        """Request a GPIO line that drives the mux's RESET pin.

        Args:
            device: The GPIO chip, such as /dev/gpiochip0.
            line: Number of the line on it.

        Raises:
            HardwareError: There is no such chip or line, it is in use, or this user may not use it.
        """
        try:
            request = gpiod.request_lines(device, config={line: SETTINGS}, consumer="footsense")
        except OSError as error:
            raise HardwareError(
                f"{device} line {line}: {error.strerror}; see `gpioinfo`, and the service's user belongs in group gpio"
            ) from error
        return cls(request, device, line)

    def pulse(self) -> None:
        """Pull the pin low and release it.

        A system call takes a thousand times the 6 ns that a TCA9548A needs (data sheet SCPS207, t_W(L)).

        Raises:
            HardwareError: The line is gone.
        """
        try:
            for value in (Value.ACTIVE, Value.INACTIVE):
                self._request.set_value(self._line, value)
        except OSError as error:
            raise HardwareError(f"{self._device} line {self._line}: {error.strerror}") from error

    def close(self) -> None:
        """Give the line back to the kernel."""
        self._request.release()
