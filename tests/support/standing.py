"""Feet that stand, walk, creep and drift in virtual time, one scenario for each leg, without any chips."""

import math

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.baseline import BaselineTracker
from footsense.estimation.elements import ElementStatus
from footsense.estimation.noise import ReadingNoise
from footsense.estimation.settings import (
    ContactLimits,
    EstimationLimits,
    MountedFeet,
    Sensitivity,
    TareLimits,
)
from footsense.frames import ELEMENTS, CapFrame, CommandResult, Flag
from tests.support.feet import DESIGN, RANGE_END_PF, TRAINED

Vector = NDArray[np.float64]

SCAN_S = 0.0244
CONVERSION_S = SCAN_S / ELEMENTS
TOUCH_N = 0.03
WINDOW = 8
NOISE_FF = 0.916
#: Closures that 1 N makes on the elements, over the gap [1]; their trimmed mean is 0.4.
PER_NEWTON = 0.4 * np.array([0.9, 1.05, 0.9, 1.05, 1.2, 1.05, 0.9, 1.05, 0.9])
SENSITIVITY = Sensitivity(
    load_n_per_mean_closure=2.5,
    force_sigma_n_per_baseline_error=np.array([1.0, 1.0, 2.7]),
    force_n_per_closure=np.zeros((1, 9, 3)),
    force_sigma_n_per_reading_noise=np.zeros(3),
)
#: What an even drift does to the force along the leg [mN/fF]; HARDWARE's 1.5 fF/K are 1 mN/K.
MN_PER_FF = 0.66
#: Rubber that goes on giving way for minutes: share and time constant [s].
CREEP = ((0.02, 10.0), (0.03, 300.0))


class Creep:
    """What the closures of crept rubber are too large, as a force [N]."""

    def __init__(self) -> None:
        self._late_n = [np.zeros(1) for _ in CREEP]

    def after(self, force_n: Vector, passed_s: float) -> Vector:
        for k, (share_rel, time_s) in enumerate(CREEP):
            kept = math.exp(-passed_s / time_s)
            self._late_n[k] = share_rel * force_n * (1 - kept) + kept * self._late_n[k]
        owed_n: Vector = np.sum(self._late_n, axis=0)
        return owed_n


class Standing:
    """Legs under a baseline tracker, fed scan by scan or conversion by conversion."""

    def __init__(self, n_legs: int, *, track: bool = True, element_by_element: bool = False) -> None:
        unloaded_pf = np.full((n_legs, ELEMENTS), DESIGN.unloaded_pf)
        self.tracker = BaselineTracker(
            MountedFeet.of(DESIGN, [None] * n_legs),
            TRAINED,
            EstimationLimits(
                scan_ns=round(SCAN_S * 1e9),
                range_end_pf=RANGE_END_PF,
                tare=TareLimits(window_scans=WINDOW),
                contact=ContactLimits(threshold_n=TOUCH_N),
                track_baseline=track,
            ),
            SENSITIVITY,
            ReadingNoise(n_legs, np.eye(ELEMENTS)),
        )
        self.outcomes: list[CommandResult] = []
        self.t_ns = 1_000_000_000
        self.period_s = CONVERSION_S if element_by_element else SCAN_S
        self._element_by_element = element_by_element
        self._turn = 0
        self._pf = unloaded_pf.copy()
        self._stamps = np.zeros((n_legs, ELEMENTS), np.int64)
        self._random = np.random.default_rng(1)

    def feed(
        self, force_n: Vector | float, drift_ff: Vector | float = 0.0, passed_s: float | None = None
    ) -> None:
        """Let time pass and read the feet: a force for each leg [N], a drift for each or each element [fF]."""
        self.t_ns += round((passed_s or self.period_s) * 1e9)
        shape = self._pf.shape
        force = np.broadcast_to(np.asarray(force_n, float), shape[:1])
        drift = np.broadcast_to(
            np.asarray(drift_ff, float).reshape(-1, 1) if np.ndim(drift_ff) == 1 else drift_ff, shape
        )
        noise = self._random.normal(0.0, NOISE_FF, shape)
        pf = DESIGN.capacitance_pf(force[:, None] * PER_NEWTON * DESIGN.gap_um) + (drift + noise) * 1e-3
        if self._element_by_element:
            self._turn = (self._turn + 1) % ELEMENTS
            read = np.arange(ELEMENTS) == self._turn
            if not self._stamps.any():
                read[:] = True
            self._pf = np.where(read, pf, self._pf)
            self._stamps = np.where(read, self.t_ns, self._stamps)
        else:
            self._pf = pf
            self._stamps = self.t_ns - np.broadcast_to(np.arange(ELEMENTS)[::-1] * 2_700_000, shape)
        self.show(self._pf)

    def show(self, capacitance_pf: Vector) -> None:
        """Hand a frame of these readings to the tracker."""
        reading, missing = np.zeros(capacitance_pf.shape, np.uint8), np.zeros(capacitance_pf.shape, bool)
        now_ns = self.t_ns + 2_000_000
        scan = CapFrame(0, self._stamps, capacitance_pf, reading)
        status = ElementStatus(capacitance_pf, opened=missing, over_range=missing)
        self.outcomes += self.tracker.process_tares(scan, status, missing, now_ns)
        closure_rel = DESIGN.closure_um(capacitance_pf, self.tracker.unloaded.baseline_pf) / DESIGN.gap_um
        unpredicted_n = np.full(len(capacitance_pf), np.nan)
        self.tracker.observe(
            closure_rel,
            unpredicted_n,
            unpredicted_n,
            capacitance_pf,
            self._stamps,
            self._stamps.max(axis=1),
            missing,
            now_ns,
            unpredicted_n.tolist(),
        )

    def tared(self) -> "Standing":
        """Hang in the air until the tare is done and the swing confirmed."""
        for _ in range(round(0.6 / self.period_s)):
            self.feed(0.0)
        return self

    @property
    def in_contact(self) -> NDArray[np.bool_]:
        in_contact: NDArray[np.bool_] = self.tracker.flags & Flag.CONTACT != 0
        return in_contact

    @property
    def baseline_ff(self) -> Vector:
        """Distance of the baselines from the unloaded foot as it was made [fF], shape (legs, 9)."""
        return (self.tracker.unloaded.baseline_pf - DESIGN.unloaded_pf) * 1e3


def stance_n(t_s: float, period_s: float = 1.2, duty_rel: float = 0.6) -> float:
    """Return the force of a walk [N]: stances of 1 N with rounded flanks."""
    phase = t_s % period_s / period_s / duty_rel
    if phase >= 1.0:
        return 0.0
    return 0.5 - 0.5 * math.cos(math.pi * min(min(phase, 1 - phase) / 0.2, 1.0))
