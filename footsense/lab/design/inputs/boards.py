"""Converter boards: noise, input range and scan time from the data sheets."""

from typing import NamedTuple

from firmware_interface.chips import ad7746, fdc1004
from footsense.frames import ELEMENTS
from footsense.lab.foot_file import MIN_UNLOADED_PF
from footsense.lab.training.load_cases import BASELINE_NOISE_PF, NOISE_PF

#: Least unloaded and largest capacitance that board `ad7746` reads with any chip [pF]: its CAPDAC is fixed
#: (docs/adr/0012-ad7746-fixed-capdac-measured-step.md).
_AD7746_RANGE_PF = (4.0, 9.3)
#: Noise of a baseline over that of a conversion [1], as with board `fdc1004`.
_BASELINE_NOISE_REL = 0.4


class Converter(NamedTuple):
    """Converter board: noise [pF], input range [pF] and time of a scan [s].

    Attributes:
        name: Name, as `board` of a configuration.
        noise_pf: Noise of a conversion [pF, rms].
        baseline_noise_pf: Noise of the baseline [pF, rms].
        min_unloaded_pf: Least capacitance of an unloaded element [pF]: above an open line and the CAPDAC's offset.
        range_end_pf: Largest capacitance that it reads [pF].
        scan_s: Nine conversions [s].
    """

    name: str
    noise_pf: float
    baseline_noise_pf: float
    min_unloaded_pf: float
    range_end_pf: float
    scan_s: float


def converter(name: str) -> Converter:
    """Return the constants of a converter board at its fastest conversion rate.

    Args:
        name: `fdc1004` or `ad7746`.
    """
    if name == "fdc1004":
        fastest = fdc1004.RATES[max(fdc1004.RATES)]
        end_pf = fdc1004.capacitance_pf(fdc1004.CODE_MAX)
        scan_s = 1e-9 * ELEMENTS * fastest.conversion_ns
        return Converter(name, NOISE_PF, BASELINE_NOISE_PF, MIN_UNLOADED_PF, end_pf, scan_s)
    quick = ad7746.RATES[max(ad7746.RATES)]
    noise_pf, scan_s = 1e-3 * quick.noise_ff, 1e-9 * ELEMENTS * quick.conversion_ns
    return Converter(name, noise_pf, _BASELINE_NOISE_REL * noise_pf, *_AD7746_RANGE_PF, scan_s)
