"""GPIO line of Linux that drives a mux's RESET pin; the only module that imports gpiod.

The line is requested as an open-drain, active-low output: inactive it is released, so that the mux's own pull-up keeps
the pin high, whatever the mux's supply is.
"""

import logging

import gpiod
from gpiod.line import Direction, Drive, Value

from footsense.errors import HardwareError

_log = logging.getLogger(__name__)

SETTINGS = gpiod.LineSettings(
    direction=Direction.OUTPUT, drive=Drive.OPEN_DRAIN, active_low=True, output_value=Value.INACTIVE
)


class LinuxResetLine:
    """RESET pin of a mux on a GPIO line; a GPIO line that has disappeared is requested again at each pulse.

    Args:
        request: The line, requested and inactive.
        device: The GPIO chip.
        line: Number of the line on it.
    """

    def __init__(self, request: gpiod.LineRequest, device: str, line: int) -> None:
        self._request: gpiod.LineRequest | None = request
        self._device = device
        self._line = line

    @classmethod
    def open(cls, device: str, line: int) -> "LinuxResetLine":
        """Request a GPIO line as output to the mux's RESET pin; return it as a reset line.

        Args:
            device: The GPIO chip, such as /dev/gpiochip0.
            line: Number of the line on it.

        Raises:
            HardwareError: There is no such chip or line, it is in use, or this user may not use it.
        """
        try:
            return cls(_request_line(device, line), device, line)
        except OSError as error:
            raise HardwareError(
                f"{device} line {line}: {error.strerror}; see `gpioinfo`, and the service's user belongs in group gpio"
            ) from error

    def pulse(self) -> None:
        """Pull the RESET pin low for a moment; log once if the GPIO line has disappeared.

        A system call takes a thousand times the 6 ns that a TCA9548A needs (data sheet SCPS207, t_W(L)).
        """
        was_there = self._request is not None
        try:
            if self._request is None:
                self._request = _request_line(self._device, self._line)
            for value in (Value.ACTIVE, Value.INACTIVE):
                self._request.set_value(self._line, value)
        except OSError as error:
            self.close()
            if was_there:
                _log.warning(
                    "%s line %d: %s; a leg that holds its bus low stops the others until it is back",
                    self._device,
                    self._line,
                    error.strerror,
                )

    def close(self) -> None:
        """Release the GPIO line."""
        if self._request is not None:
            self._request.release()
            self._request = None


def _request_line(device: str, line: int) -> gpiod.LineRequest:
    """Request a GPIO line as an output."""
    return gpiod.request_lines(device, config={line: SETTINGS}, consumer="footsense")
