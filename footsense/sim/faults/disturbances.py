"""Disturbances of a foot's readings: what couples into its lines, added at the converter's input.

A converter averages over its conversion, and the elements are read one after the other: a tone counts with its mean
over each conversion, so that the scan aliases it. Noise, bursts and impulses are drawn anew for each conversion.
"""

import math
from collections.abc import Sequence

import numpy as np

from footsense.frames import ELEMENTS, ROWS
from footsense.sim.faults import scene_faults
from footsense.sim.faults.scene_faults import Schedule

#: Time in which noise that all readings have in common changes [s]: longer than a scan, as noise correlates by 0.8
#: between the channels of a scanned rubber sensor (18 unloaded recordings of CoinFT-TRACE).
COMMON_NOISE_TIME_CONSTANT_S = 0.1
#: Share of a leak that each column gets [1]: the contacts of a wet tail lie side by side.
_LEAKAGE_SHARES = (1.0, 0.6, 0.3)

_Random = scene_faults.WhiteNoise | scene_faults.NoiseBursts | scene_faults.Impulses


class CommonNoise:
    """Slow noise of unit variance: white noise through a low pass.

    Args:
        random: Source of randomness.
    """

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random
        self._value, self._t_ns = float(random.standard_normal()), 0

    def at(self, t_ns: int) -> float:
        """Return its value at a time [ns], which does not go back."""
        elapsed_s = max(t_ns - self._t_ns, 0) * 1e-9
        kept = math.exp(-elapsed_s / COMMON_NOISE_TIME_CONSTANT_S)
        self._t_ns = t_ns
        self._value = kept * self._value + math.sqrt(1.0 - kept * kept) * float(
            self._random.standard_normal()
        )
        return self._value

    def mixed_with(self, own: float, share_rel: float, t_ns: int) -> float:
        """Return the sum of it and of white noise of unit variance, of unit variance too.

        Args:
            own: The white noise.
            share_rel: Share of the variance that it has [1].
            t_ns: Time, which does not go back [ns].
        """
        return math.sqrt(1.0 - share_rel) * own + math.sqrt(share_rel) * self.at(t_ns)


class Disturbances:
    """All disturbances of one leg.

    Args:
        disturbances: Those of the leg.
        random: Source of randomness.
        metal_ff: What metal beside the tail adds to the reading of each element [fF].
    """

    def __init__(
        self,
        disturbances: Sequence[scene_faults.Disturbance],
        random: np.random.Generator,
        metal_ff: Sequence[float] = (0.0,) * ELEMENTS,
    ) -> None:
        self._schedule = Schedule((each.span_ns, each) for each in disturbances)
        self._random = random
        self._metal_ff = metal_ff
        self._common = CommonNoise(random)

    def column_of_pin(self, column: int, t_ns: int) -> int:
        """Return the column that a pin converts at a time [ns]; 3, beyond the last one, is not connected."""
        shifted = any(isinstance(each, scene_faults.ChannelsShifted) for each in self._schedule.at(t_ns))
        return column + shifted

    def added_pf(self, row_mask: int, column: int, t_start_ns: int, t_end_ns: int) -> float:
        """Return what is added to a conversion [pF].

        Args:
            row_mask: Bit for each selected row.
            column: The column that is converted.
            t_start_ns: Start of the conversion [ns].
            t_end_ns: Its end [ns].
        """
        added_ff = 0.0
        for each in self._schedule.at(t_start_ns):
            if isinstance(each, _Random):
                added_ff += self._drawn_ff(each, t_start_ns)
            elif isinstance(each, scene_faults.MetalBesideTail):
                row = max((row_mask & -row_mask).bit_length() - 1, 0)
                # A pin of lines that have shifted by one may have no line.
                added_ff += self._metal_ff[row * ROWS + column] if max(row, column) < ROWS else 0.0
            else:
                added_ff += _certain_ff(each, row_mask, column, t_start_ns, t_end_ns)
        return added_ff * 1e-3

    def _drawn_ff(self, each: _Random, t_ns: int) -> float:
        draw = self._random.standard_normal
        match each:
            case scene_faults.WhiteNoise(noise_ff=noise_ff, common_rel=share):
                return noise_ff * self._common.mixed_with(draw(), share, t_ns)
            case scene_faults.NoiseBursts(noise_ff=noise_ff, period_s=period_s, active_s=active_s):
                active = ((t_ns - each.at_ns) * 1e-9) % period_s < active_s
                return noise_ff * draw() if active else 0.0
            case scene_faults.Impulses(amplitude_ff=amplitude_ff, rate_rel=rate_rel):
                return amplitude_ff if self._random.random() < rate_rel else 0.0


def _certain_ff(
    each: scene_faults.Disturbance, row_mask: int, column: int, t_start_ns: int, t_end_ns: int
) -> float:
    """Return what a disturbance without chance adds to a conversion [fF]; arguments as of `added_pf`."""
    match each:
        case scene_faults.Tone():
            return _mean_of_tone_ff(each, t_start_ns, t_end_ns)
        case scene_faults.GroundShift(amplitude_ff=amplitude_ff):
            return amplitude_ff
        case scene_faults.ColumnShift(amplitude_ff=amplitude_ff, column=shifted):
            return amplitude_ff if column == shifted else 0.0
        case scene_faults.RowShift(amplitude_ff=amplitude_ff, row=row):
            return amplitude_ff if row_mask >> row & 1 else 0.0
        case scene_faults.Leakage(amplitude_ff=amplitude_ff, time_constant_s=time_constant_s):
            grown = -math.expm1(-(t_start_ns - each.at_ns) * 1e-9 / time_constant_s)
            return amplitude_ff * grown * _LEAKAGE_SHARES[min(column, 2)]
    return 0.0


def _mean_of_tone_ff(tone: scene_faults.Tone, t_start_ns: int, t_end_ns: int) -> float:
    """Return the mean of a sine over a conversion [fF]."""
    per_ns = 2e-9 * math.pi * tone.frequency_hz
    start, end = (per_ns * (t_ns - tone.at_ns) for t_ns in (t_start_ns, t_end_ns))
    return tone.amplitude_ff * (math.cos(start) - math.cos(end)) / (end - start)
