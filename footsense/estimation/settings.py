"""Settings of the estimation: a robot's mounted feet, and the limits of tare, contact and age."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import replace

from footsense.foot.capacitor import Capacitor
from footsense.foot.parameters import KNOWN_EXACTLY, FootParameters, ForceUncertainty
from footsense.frames import ELEMENTS, Vector

#: Silence of a leg [ns] after which its foot may be another one, and its events meanwhile are unknown: nobody swaps a
#: foot in less.
LONG_SILENCE_NS = 250_000_000
#: Shortest time of what legs and rubber do [ns]: stances, ringing after a lift-off. Also the period of what changes
#: slowly: the baselines' uncertainty, and gait frames without an event.
SLOW_PERIOD_NS = 100_000_000
#: Standard deviations beyond which a difference is not noise [1].
SIGMAS = 5.0
#: Share of a whole that is small against it [1].
SMALL_SHARE = 0.25
#: Limit of what an element's closure differs from the others' prediction, over its gap, and motion that is clearly none
#: of that [1].
RESIDUAL_LIMIT = 0.03
CLEAR_MOTION_REL = 3.0 * RESIDUAL_LIMIT
#: Time within which loads of a foot, and so the errors of their estimates, stay the same [s].
CORRELATED_S = 9e-3
#: Time over which pulls, loads, and what feet have shown of the ground are remembered [s].
MEMORY_S = 10.0
#: Noise of a reading and of a baseline, the mean of a tare, for which networks are trained [pF, rms].
READING_NOISE_PF, BASELINE_NOISE_PF = 0.916e-3, 0.2e-3
#: Share of a drift that differs between the elements; the rest is common to all. An assumption: no foot was heated.
UNEVEN_DRIFT_SHARE = 0.2
#: Age of a measurement from which it is stale, over the time of a scan, where none is configured [1].
MAX_AGE_SCANS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class MountedFeet:
    """Parameters of the foot on each leg; arrays have the shape (legs, elements).

    Attributes:
        stray_pf: Known capacitance in parallel with each element [pF].
        unloaded_pf: Expected reading of each element of the free foot, without stray [pF].
        gap_um: Air gap of each element [um].
        gain_rel: Closure of each element by the design's electrodes, over its real closure [1]. All stages use real
            closures over the design's gap.
        uncertainty: What nobody knows of the foot on each leg.
        names: Name of the foot on each leg that `unloaded_pf` was measured on; empty where it is a design value.
        parameters: Calibration of each foot; None where there is none.
        calibrated_at_c: Its temperature then [degC], NaN where it was not measured; None for a foot whose force is not
            to be corrected by temperature.
    """

    stray_pf: Vector
    unloaded_pf: Vector
    gap_um: Vector
    gain_rel: Vector
    uncertainty: tuple[ForceUncertainty, ...]
    names: tuple[str, ...]
    parameters: tuple[FootParameters | None, ...]
    calibrated_at_c: tuple[float | None, ...]

    def distance_times_capacitance_pf(self, design: Capacitor) -> Vector:
        """Return relative plate distance times capacitance of each element (constant) [pF], shape (legs, elements)."""
        return design.plate_distance_um(np.ones(1)) / design.gap_um / self.gain_rel

    @classmethod
    def of(
        cls,
        design: Capacitor,
        parameters: Sequence[FootParameters | None],
        *,
        stray_pf: Vector | float = 0.0,
        reading_pf: Vector | float = np.nan,
        names: Sequence[str] = (),
        uncertainty: Sequence[ForceUncertainty] = (),
        calibrated_at_c: Sequence[float | None] = (),
    ) -> "MountedFeet":
        """Return the feet of legs: calibrated, else as configured, else as designed.

        Args:
            design: The capacitors as designed.
            parameters: Calibration of each leg's foot, None for none.
            stray_pf: Known stray of feet without a calibration [pF], to be broadcast to (legs, elements).
            reading_pf: Reading of each element of the free foot, stray included [pF], likewise; NaN for that of the
                calibration, or of the design.
            names: As the attribute; none by default.
            uncertainty: As the attribute; by default what a fit left, and nothing of a foot without one.
            calibrated_at_c: As the attribute; None for each by default.
        """
        n_legs = len(parameters)

        def known(name: str, otherwise: Vector | float) -> Vector:
            rows = np.broadcast_to(otherwise, (n_legs, ELEMENTS))
            return np.array(
                [
                    row if foot is None else getattr(foot, name)
                    for foot, row in zip(parameters, rows, strict=True)
                ]
            )

        stray_pf = known("stray_pf", stray_pf)
        reading_pf = np.where(np.isnan(reading_pf), known("unloaded_pf", np.nan), reading_pf)
        return cls(
            stray_pf=stray_pf,
            # The design's capacitance excludes stray; a reading of the foot includes it.
            unloaded_pf=np.where(np.isnan(reading_pf), design.unloaded_pf, reading_pf - stray_pf),
            gap_um=known("gap_um", design.gap_um),
            gain_rel=known("gain_rel", 1.0),
            uncertainty=tuple(uncertainty)
            or tuple(
                ForceUncertainty(*2 * [foot.error_rel]) if foot else KNOWN_EXACTLY for foot in parameters
            ),
            names=tuple(names) or ("",) * n_legs,
            parameters=tuple(parameters),
            calibrated_at_c=tuple(calibrated_at_c) or (None,) * n_legs,
        )


class TareLimits(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Section `tare` of a configuration: when the present readings become the baseline of a foot.

    Attributes:
        window_scans: Scans that are averaged. Of a foot that has no baseline after a first refusal as many as in a
            tenth of a second, if these are fewer, and at least half.
        noise_limit_ff: Largest standard deviation of any element over the window [fF].
        unloaded_limit_rel: Largest deviation of any element from `unloaded_pf` that counts as unloaded [1]; 3 % of the
            capacitance are 4 % of the gap. A third of it more on the mean of all elements, as by a load, is loaded.
    """

    window_scans: Annotated[int, Meta(ge=2, le=1000)] = 8
    noise_limit_ff: Annotated[float, Meta(gt=0.0, le=1000.0)] = 5.0
    unloaded_limit_rel: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.03

    def for_uncalibrated_foot(self) -> "TareLimits":
        """Return the limits for a foot that may read far from its design, as nobody has calibrated it yet."""
        return replace(self, unloaded_limit_rel=_UNCALIBRATED_UNLOADED_LIMIT_REL)

    @property
    def newest_weight(self) -> float:
        """Share of the newest scan in a running average, as over the window [1]."""
        return 2.0 / (self.window_scans + 1)

    @property
    def mean_limit_rel(self) -> float:
        """Largest mean of the deviations of all elements that counts as unloaded [1]: of a light load, or 30 K."""
        return self.unloaded_limit_rel / 3.0

    def unloaded_limit_pf(self, unloaded_pf: Vector) -> Vector:
        """Return the largest deviation of each element that counts as unloaded [pF], the shape of `unloaded_pf`."""
        return self.unloaded_limit_rel * unloaded_pf

    @property
    def quiet_variance_pf2(self) -> float:
        """Largest variance that is within the limit of the noise [pF2]."""
        return (1e-3 * self.noise_limit_ff) ** 2


#: Unloaded limit of a foot that is not calibrated [1].
_UNCALIBRATED_UNLOADED_LIMIT_REL = 0.5


#: Contact threshold over the feet's largest force, where none is configured [1].
CONTACT_THRESHOLD_REL = 0.015


class ContactLimits(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Section `contact` of a configuration: when a foot is in contact.

    Attributes:
        threshold_n: Least load along the leg, above that in swing, from which a foot is in contact [N]; more where
            swings show more pull of the foot's own mass, a fifth of the mean load of its stances before it has swung.
            None: 1.5 % of the largest force that the feet's network is trained for, 0.03 N for the paper's.
        friction: Coefficient of friction of the ground [1], to a fifth: a foot slides where its tangential over normal
            force comes to it. None: not known, and no slip is reported; 0.5 is assumed for whether a foot holds.
    """

    threshold_n: Annotated[float, Meta(ge=0.002, le=10.0)] | None = None
    friction: Annotated[float, Meta(ge=0.1, le=2.0)] | None = None

    def least_n(self, max_force_n: float) -> float:
        """Return the threshold of feet whose network is trained up to a force [N]."""
        if self.threshold_n is not None:
            return self.threshold_n
        return round(CONTACT_THRESHOLD_REL * max_force_n, 6)


class Sensitivity(NamedTuple):
    """Change of estimated load and force per gap closure [N].

    Attributes:
        load_n_per_mean_closure: Load along the leg over the trimmed mean of the closures [N].
        force_sigma_n_per_baseline_error: Standard deviation of each component of the force if every baseline is off by
            one gap, a fifth of that differing between the elements [N], shape (3,).
        force_n_per_closure: Change of the force by each element's closure, at light and heavy loads [N], shape
            (loads, elements, 3).
        force_sigma_n_per_reading_noise: Standard deviation of each component of the force if every reading has noise of
            one gap, independent of all others [N], shape (3,).
    """

    load_n_per_mean_closure: float
    force_sigma_n_per_baseline_error: Vector
    force_n_per_closure: Vector
    force_sigma_n_per_reading_noise: Vector


class EstimationLimits(Struct, frozen=True, kw_only=True):
    """How the feet are read, and what is configured of the estimation.

    Attributes:
        scan_ns: Time of a scan [ns].
        range_end_pf: Least capacitance of an element over the converter's range [pF].
        tare: Limits of a tare.
        contact: Limits of contact.
        max_age_ns: Age of the oldest reading from which a measurement is stale [ns]; None for `MAX_AGE_SCANS`.
        track_baseline: Whether a baseline follows a foot in swing.
    """

    scan_ns: int
    range_end_pf: float
    tare: TareLimits = TareLimits()
    contact: ContactLimits = ContactLimits()
    max_age_ns: int | None = None
    track_baseline: bool = True
