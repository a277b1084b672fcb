"""Simulated three-axis force sensor under a foot (BL Autotech MINI 4/20), on a serial port.

It measures the foot's push, the opposite of the ground reaction, along the foot's axes. Its readings have the
nonlinearity of the data sheet, noise, and its resolution; it sends them as lines of text with time stamps of its own
clock.

The nonlinearity of a specimen is a bow over the whole range: 1.5 % of 4 kgf are 60 gf in the middle of it, and act on
small forces as a gain error of up to 3.9 %.

Source:
    Aoyagi et al., table II.
"""

import math
from collections.abc import Callable

import numpy as np

from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import Vector
from footsense.ports import Clock

#: Rated value and resolution of fx, fy, fz [gf]; table II of the paper.
RATED_GF = np.array([4000.0, 4000.0, 8000.0])
RESOLUTION_GF = np.array([4.0, 4.0, 12.0])
#: Nonlinearity over the rated value [1]; table II of the paper.
MAX_NONLINEARITY_REL = 0.015
SAMPLE_RATE_HZ = 200
_SAMPLE_PERIOD_NS = 1_000_000_000 // SAMPLE_RATE_HZ
#: Columns of a line: the sensor's time, and the forces in whole gf.
LINE_COLUMNS = ("time_us", "fx", "fy", "fz")
#: Duration of a line of 24 characters at 115200 bit/s [ns].
LINE_TRANSMISSION_NS = 2_083_000
#: Noise that dithers the quantisation, so that averaging helps [steps].
_DITHER_NOISE_STEPS = 0.5
#: Largest offset of the unloaded sensor [steps], and largest error of its clock [1].
_MAX_OFFSET_STEPS = 10.0
_MAX_CLOCK_ERROR_REL = 50e-6
#: Largest value of u - u^3, at u = 1 / sqrt(3).
_MAX_CUBIC_BOW = 2.0 / (3.0 * math.sqrt(3.0))


def draw_nonlinearity_amplitude_gf(random: np.random.Generator, linearity_rel: float) -> Vector:
    """Return a random nonlinearity amplitude per axis [gf], shape (3,), of one sensor specimen."""
    bow_gf: Vector = linearity_rel / _MAX_CUBIC_BOW * RATED_GF * random.uniform(-1, 1, 3)
    return bow_gf


def nonlinearity_gf(bow_gf: Vector, load_gf: Vector) -> Vector:
    """Return the reading error by nonlinearity at given loads [gf], shape (..., 3)."""
    share = np.clip(load_gf / RATED_GF, -1, 1)
    nonlinearity_error_gf: Vector = bow_gf * (share - share**3)
    return nonlinearity_error_gf


class SimulatedForceSensor:
    """One simulated specimen of the force sensor with its errors, as a serial port.

    Args:
        true_force_n_at: Ground reaction on the foot at a time [N], shape (3,).
        clock: Virtual clock.
        seed: Seed of the specimen and its noise.
        linearity_rel: Largest nonlinearity over the rated value [1].

    Attributes:
        n_opened: Number of times that its line was opened.
    """

    def __init__(
        self,
        true_force_n_at: Callable[[int], Vector],
        clock: Clock,
        seed: int,
        linearity_rel: float = MAX_NONLINEARITY_REL,
    ) -> None:
        self.n_opened = 1
        self._true_force_n_at = true_force_n_at
        self._clock = clock
        self._random = np.random.default_rng((seed, 6))
        self._bow_gf = draw_nonlinearity_amplitude_gf(self._random, linearity_rel)
        self._offset_gf = RESOLUTION_GF * self._random.uniform(-_MAX_OFFSET_STEPS, _MAX_OFFSET_STEPS, 3)
        self._period_ns = _SAMPLE_PERIOD_NS * (
            1 + self._random.uniform(-_MAX_CLOCK_ERROR_REL, _MAX_CLOCK_ERROR_REL)
        )
        self._t_first_us = int(self._random.integers(0, 1_000_000_000))
        self._started_ns: int | None = None
        self._n_sent = 0

    def write(self, data: bytes) -> None:
        """Start streaming upon any command; the first sample is taken one period later."""
        if data:
            self._started_ns, self._n_sent = self._clock.now_ns(), 0

    def wait_for_bytes_until_ns(self, t_ns: int) -> None:
        """Advance the clock to a time [ns]."""
        self._clock.sleep_until_ns(t_ns)

    def close(self) -> None:
        """Do nothing: a simulated port holds no resources."""

    def read(self) -> bytes:
        """Return the text lines sent since the last call, as bytes."""
        if self._started_ns is None:
            return b""
        now_ns = self._clock.now_ns()
        lines: list[bytes] = []
        while True:
            taken_ns = self._started_ns + round((self._n_sent + 1) * self._period_ns)
            if taken_ns + LINE_TRANSMISSION_NS > now_ns:
                return b"".join(lines)
            self._n_sent += 1
            sensor_us = self._t_first_us + self._n_sent * _SAMPLE_PERIOD_NS // 1000
            lines.append(b"%d,%d,%d,%d\r\n" % (sensor_us, *self._quantized_reading_gf(taken_ns)))

    def _quantized_reading_gf(self, t_ns: int) -> list[int]:
        """Return the sensor's output per axis at a time [gf], rounded to its resolution and limited to its range."""
        load_gf = -self._true_force_n_at(t_ns) / GRAM_FORCE_N
        noise_gf = _DITHER_NOISE_STEPS * RESOLUTION_GF * self._random.normal(size=3)
        reading_gf = load_gf + nonlinearity_gf(self._bow_gf, load_gf) + self._offset_gf + noise_gf
        counted_gf = RESOLUTION_GF * np.rint(reading_gf / RESOLUTION_GF)
        return [int(value) for value in np.clip(counted_gf, -RATED_GF, RATED_GF)]
