"""What the daemon tells the estimation of a robot: its mounted feet, and the limits of tare, contact and age."""

from dataclasses import dataclass

import numpy as np

from firmware_interface.chips import fdc1004
from footsense.foot.capacitor import CapacitorDesign
from footsense.frames import ELEMENTS, Vector

#: Least capacitance of an element over the range of an FDC1004 [pF].
CONVERTER_MAX_PF = fdc1004.capacitance_pf(fdc1004.CODE_MAX)


@dataclass(frozen=True, slots=True, kw_only=True)
class MountedFeet:
    """Parameters of the foot on each leg; arrays have the shape (legs, elements).

    Attributes:
        stray_pf: Known capacitance in parallel with each element [pF].
        unloaded_pf: Expected reading of each element of the free foot, without stray [pF].
        gap_um: Air gap of each element [um].
        gain_rel: Closure of each element by the design's electrodes, over its real closure [1]. All stages use real
            closures over the design's gap.
        names: Name of the foot on each leg that `unloaded_pf` was measured on; empty where it is a design value.
    """

    stray_pf: Vector
    unloaded_pf: Vector
    gap_um: Vector
    gain_rel: Vector
    names: tuple[str, ...]

    def distance_times_capacitance_pf(self, design: CapacitorDesign) -> Vector:
        """Return relative plate distance times capacitance of each element (constant) [pF], shape (legs, elements)."""
        return design.plate_distance_um(np.ones(1)) / design.gap_um / self.gain_rel

    @classmethod
    def as_designed(cls, design: CapacitorDesign, n_legs: int, stray_pf: float = 0.0) -> "MountedFeet":
        """Return the parameters of feet that are as their design."""
        ones = np.ones((n_legs, ELEMENTS))
        return cls(
            stray_pf=stray_pf * ones,
            unloaded_pf=design.unloaded_pf * ones,
            gap_um=design.gap_um * ones,
            gain_rel=ones,
            names=("",) * n_legs,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TareLimits:
    """Limits of a tare.

    Attributes:
        window_scans: Scans that are averaged, at least 2.
        noise_limit_ff: Largest standard deviation of any element over the window [fF].
        unloaded_limit_rel: Largest deviation of any element from the free foot's expected reading [1].
    """

    window_scans: int
    noise_limit_ff: float
    unloaded_limit_rel: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactLimits:
    """Thresholds for contact and for a confirmed swing.

    Attributes:
        min_threshold_n: Least load above that in swing that is contact [N]; more where swings show more noise and
            shake.
        max_swing_rise_n_per_s: Fastest rise of the load in swing [N/s]: five times the fastest drift, a
            fiftieth of a slow load.
        swing_confirmed_after_s: Time after lift-off from which a swing is confirmed [s]: most of the rubber's quick
            recovery is over by then, and half the swing of a fast gait is left.
    """

    min_threshold_n: float
    max_swing_rise_n_per_s: float = 0.5e-3
    swing_confirmed_after_s: float = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimationLimits:
    """Limits and times of the estimation.

    Attributes:
        tare: Limits of a tare.
        contact: Thresholds of contact.
        scan_ns: Time of a scan [ns].
        max_age_ns: Age of the oldest reading from which a measurement is stale [ns].
        track_baseline: Whether a baseline follows a foot in swing.
        range_end_pf: Least capacitance of an element over the converter's range [pF].
    """

    tare: TareLimits
    contact: ContactLimits
    scan_ns: int
    max_age_ns: int
    track_baseline: bool = True
    range_end_pf: float = CONVERTER_MAX_PF
