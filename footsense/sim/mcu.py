"""A simulated microcontroller that scans feet by itself, and the serial line to it in virtual time.

It shares only the layout of a record with the driver. Behaviours kept: a clock of its own that starts anywhere, drifts
and wraps; numbers that begin anew with a reset; all records of a scan together, as soon as they can be on the line; a
line that loses and garbles bytes, and is unplugged. Not simulated: what of a USB adapter holds bytes back.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface import fdc1004
from firmware_interface.can_codes import NODE_IDS
from firmware_interface.serial_frames import (
    ELEMENTS,
    FRAME_BYTES,
    NO_VALUE,
    NoValue,
    Record,
    RecordFlag,
    encode_record,
    pack_values,
)
from footsense.ports import Clock
from footsense.sim.faults import Span, during

__all__ = ["LineFaults", "SimulatedLine", "SimulatedMcu"]

_NS_PER_US = 1000
_AF_PER_PF = 1e6
_BITS_PER_BYTE = 10  # 8N1
_WRAP_US = 1 << 32
#: Records of a leg in which it says that it has just started.
_STARTING_RECORDS = 256
#: Noise of one conversion [pF]: that of the default board's fastest one, for want of a board to measure.
_NOISE_PF = fdc1004.RATES[400].noise_ff * 1e-3
#: By how much its crystal runs fast [1].
_CLOCK_ERROR_REL = 40e-6

#: Capacitances of a leg's elements at a time [ns], stray included [pF], shape (9,).
Elements = Callable[[int], NDArray[np.float64]]


class SimulatedMcu:
    """The controller.

    Args:
        legs: What it measures on each leg, by the leg's name.
        step_us: Time from element to element [us]; 0 to convert them all together.
        starts_us: What its clock says at time 0 [us].
        noise: Source of its noise; None for a converter without.

    Attributes:
        silent_ns: Spans in which a leg's converter does not answer, by the leg's name [ns].
    """

    def __init__(
        self,
        legs: Mapping[str, Elements],
        *,
        step_us: int = 0,
        starts_us: int = 0,
        noise: np.random.Generator | None = None,
    ) -> None:
        self.silent_ns: dict[str, Span] = {}
        self._legs = dict(legs)
        self._step_us = step_us
        self._starts_us = starts_us
        self._started_ns = 0
        self._noise = noise
        self._n_scans = 0
        self._lead = b""

    def restart(self, t_ns: int) -> None:
        """Be reset at a time [ns]: clock and numbers begin at 0, and a zero ends what was cut off."""
        self._lead = b"\0"
        self._starts_us = 0
        self._started_ns = t_ns
        self._n_scans = 0

    def scan(self, t_ns: int) -> bytes:
        """Return the records of a scan whose first conversion has its middle at a time [ns], behind each other."""
        t_us = self._starts_us + round((t_ns - self._started_ns) * (1 + _CLOCK_ERROR_REL)) // _NS_PER_US
        number, self._n_scans = self._n_scans, self._n_scans + 1
        flags = RecordFlag.STARTING if number < _STARTING_RECORDS else 0
        lead, self._lead = self._lead, b""
        return lead + b"".join(
            encode_record(
                Record(
                    leg=NODE_IDS[leg],
                    seq=number & 0xFFFF,
                    flags=flags,
                    step_us=self._step_us,
                    t_us=t_us % _WRAP_US,
                    values=pack_values(self._values_af(leg, elements_pf, t_ns)),
                )
            )
            for leg, elements_pf in self._legs.items()
        )

    def lasts_ns(self, baud: int) -> int:
        """Return the time from a scan's first conversion to its last bit on a line of some bits per second [ns]."""
        bits = len(self._legs) * FRAME_BYTES * _BITS_PER_BYTE
        return (ELEMENTS - 1) * self._step_us * _NS_PER_US + bits * 1_000_000_000 // baud

    def _values_af(self, leg: str, elements_pf: Elements, t_ns: int) -> list[int]:
        if leg in self.silent_ns and during([self.silent_ns[leg]], t_ns):
            return [NO_VALUE + NoValue.NO_ANSWER] * ELEMENTS
        if self._step_us:
            step_ns = self._step_us * _NS_PER_US
            values_pf = np.array([elements_pf(t_ns + n * step_ns)[n] for n in range(ELEMENTS)])
        else:
            values_pf = elements_pf(t_ns)
        if self._noise is not None:
            values_pf = values_pf + self._noise.normal(0.0, _NOISE_PF, ELEMENTS)
        over = values_pf * _AF_PER_PF >= 2**31
        values: list[int] = (
            np.where(over, NO_VALUE + NoValue.OVER_RANGE, values_pf * _AF_PER_PF).round().astype(int).tolist()
        )
        return values


class LineFaults(NamedTuple):
    """What goes wrong on the line, and when.

    Attributes:
        lost_rel: Share of the bytes that are lost [1].
        garbled_rel: Share of the bytes of which a bit is wrong [1].
        resets_ns: When the controller is reset, in the middle of a record [ns].
        unplugged_ns: Spans in which the plug is out [ns].
    """

    lost_rel: float = 0.0
    garbled_rel: float = 0.0
    resets_ns: Sequence[int] = ()
    unplugged_ns: Sequence[Span] = ()


class SimulatedLine:
    """The serial port at the daemon's end.

    Args:
        mcu: The controller at the other end.
        clock: Virtual time: a wait for bytes moves it.
        rate_hz: Scans per second.
        baud: Bits per second.
        faults: What goes wrong.
        seed: Of what goes wrong at random.

    Attributes:
        opened: How often it has been opened.
    """

    def __init__(
        self,
        mcu: SimulatedMcu,
        clock: Clock,
        *,
        rate_hz: float,
        baud: int,
        faults: LineFaults = LineFaults(),  # noqa: B008 - a tuple
        seed: int = 0,
    ) -> None:
        self.opened = 1
        self._mcu = mcu
        self._clock = clock
        self._period_ns = round(1e9 / rate_hz)
        self._lasts_ns = mcu.lasts_ns(baud)
        self._faults = faults
        self._resets_ns = deque(sorted(faults.resets_ns))
        self._random = np.random.default_rng(seed)
        self._next_ns = clock.now_ns() + self._period_ns  # first conversion of the scan that comes next
        self._is_out = False

    def read(self) -> bytes:
        """Return what has arrived by now."""
        now_ns, arrived = self._clock.now_ns(), b""
        while self._next_ns + self._lasts_ns <= now_ns:
            arrived += self._sent(self._next_ns)
            self._next_ns += self._period_ns
        return arrived

    def wait_until_ns(self, t_ns: int) -> None:
        """Move on to the next arrival, or to `t_ns`."""
        self._clock.sleep_until_ns(min(t_ns, self._next_ns + self._lasts_ns))

    def write(self, data: bytes) -> None:
        """Take bytes; the controller does not listen."""

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def _sent(self, t_ns: int) -> bytes:
        """Return what of a scan gets through."""
        data = self._mcu.scan(t_ns)
        while self._resets_ns and self._resets_ns[0] <= t_ns:
            data = data[: len(data) // 2 + 20]
            self._mcu.restart(self._resets_ns.popleft())
        was_out, self._is_out = self._is_out, during(list(self._faults.unplugged_ns), t_ns)
        if self._is_out:
            return b""
        self.opened += was_out
        return self._harmed(data)

    def _harmed(self, data: bytes) -> bytes:
        lost_rel, garbled_rel, *_ = self._faults
        if not (lost_rel or garbled_rel):
            return data
        line = np.frombuffer(data, np.uint8)
        kept = self._random.random(len(line)) >= lost_rel
        wrong = self._random.random(len(line)) < garbled_rel
        bits = np.left_shift(1, self._random.integers(0, 8, len(line))).astype(np.uint8)
        return np.where(wrong, line ^ bits, line)[kept].tobytes()
