"""Excitation of the converted input of a FDC1004, as far as other converters notice it.

The excitation starts with the conversion, at a phase that is random against all other chips: the host starts them
microseconds apart by chance. A chip that does not convert rests at ground.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from footsense.sim.couplings import mean_product

#: Frequency at the nominal clock [Hz] (data sheet SNOSCY5, section 7.5).
_EXCITATION_HZ = 25_000.0
_NS = 1e-9


class Excitation(NamedTuple):
    """Excitation of an input by a square wave.

    Attributes:
        start_ns: Its start [ns].
        end_ns: Its end [ns].
        cin: The input.
        frequency_hz: Its frequency [Hz].
        phase: Its phase at the start [rad].
    """

    start_ns: int
    end_ns: int
    cin: int
    frequency_hz: float
    phase: float

    def phase_at(self, t_ns: int) -> float:
        """Return its phase at a time [rad]."""
        return self.phase + 2.0 * math.pi * self.frequency_hz * (t_ns - self.start_ns) * 1e-9

    def correlation(self, other: "Excitation") -> float:
        """Return the mean over this one of the product with another, 0 where only one acts [1]."""
        start_ns, end_ns = max(self.start_ns, other.start_ns), min(self.end_ns, other.end_ns)
        if end_ns <= start_ns:
            return 0.0
        phase = other.phase_at(start_ns) - self.phase_at(start_ns)
        mean = mean_product(phase, other.frequency_hz - self.frequency_hz, (end_ns - start_ns) * 1e-9)
        return mean * (end_ns - start_ns) / (self.end_ns - self.start_ns)


class Excitations:
    """The last excitations of a converter.

    Args:
        random: Source of their phases.
        clock_factor: Times of the converter over the nominal ones [1].

    Attributes:
        recent: The last ones, the newest at the end; a conversion overlaps with few, and is read before many follow.
    """

    def __init__(self, random: np.random.Generator, clock_factor: float) -> None:
        self.recent: deque[Excitation] = deque(maxlen=8)
        self._random = random
        self._frequency_hz = _EXCITATION_HZ / clock_factor

    def stop(self, t_ns: int) -> None:
        """End the excitation that runs at a time [ns]."""
        if self.recent and self.recent[-1].end_ns > t_ns:
            self.recent[-1] = self.recent[-1]._replace(end_ns=t_ns)

    def start(self, start_ns: int, end_ns: int, cin: int) -> None:
        """Begin the excitation of an input [ns]."""
        phase = self._random.uniform(0.0, 2.0 * math.pi)
        self.recent.append(Excitation(start_ns, end_ns, cin, self._frequency_hz, phase))
