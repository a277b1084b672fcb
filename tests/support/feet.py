"""Feet whose closures are given, and a pipeline whose network adds them up."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.pipeline import Pipeline
from footsense.estimation.settings import (
    ContactLimits,
    EstimationLimits,
    MountedFeet,
    Sensitivity,
    TareLimits,
)
from footsense.foot.capacitor import Capacitor
from footsense.foot.network_card import TrainedInputs
from footsense.frames import CapFrame, ContactFrame, Flag, Reading, Result
from footsense.ports import LoadEstimate, LoadEstimator, Window

DESIGN = Capacitor(gap_um=20.0, film_um=17.0, film_eps_r=2.7, electrode_area_mm2=16.0)
WINDOW = 4
SCAN_NS = 25_000_000
MAX_AGE_NS = 100_000_000
#: Above the sum of all closures in range, along all three axes.
MAX_FORCE_N = 13.0
SIGMA_N = np.array([0.01, 0.01, 0.02])
#: No uncertainty by the baseline: sigma is the network's; `test_baseline` tests the baseline's.
BASELINE_N = np.zeros(3)

#: Loads that close all gaps alike, but for a millionth: a missing closure is the mean of the others.
ALIKE = np.ones((9, 9)) + 1e-6 * np.eye(9)
TRAINED = TrainedInputs(
    design=DESIGN,
    closure_rel_min=np.full(9, -0.05),
    closure_rel_max=np.full(9, 0.8),
    moments=ALIKE,
    max_force_n=MAX_FORCE_N,
)
#: Least capacitance over the range of the converter [pF].
RANGE_END_PF = 16.0


class SumOfClosures:
    """An estimator whose every force is the sum of the newest closures, less certain with each missing element.

    Attributes:
        window: Window of the last call.
    """

    window: Window

    def estimate(self, window: Window) -> LoadEstimate:
        """Return the load of every row, after checking that a network could use the window."""
        rows = len(window.closure_rel)
        assert window.closure_rel.shape == window.age_s.shape == (rows, 3, 9)
        assert np.isfinite(window.closure_rel).all(), "the network must never see a closure that is no number"
        assert np.isfinite(window.age_s).all()
        assert (np.diff(window.age_s, axis=1) > 0.0).all(), "readings are newest first"
        assert window.missing.shape == (rows, 9)
        assert window.missing.dtype == bool
        self.window = window
        force_n = np.repeat(window.closure_rel[:, 0].sum(axis=1, keepdims=True), 3, axis=1)
        sigma_n = SIGMA_N * (1 + window.missing.sum(axis=1, keepdims=True))
        return LoadEstimate(force_n, sigma_n, np.zeros((rows, 4)), np.ones((rows, 4)))


def pipeline(estimator: LoadEstimator, n_legs: int = 2, stray_pf: float = 0.0, **own: Any) -> Pipeline:
    """Return one of feet as designed; `own` says otherwise of their `gap_um`, `gain_rel` and `uncertainty`."""
    feet = replace(MountedFeet.of(DESIGN, [None] * n_legs, stray_pf=stray_pf), **own)
    return Pipeline(
        estimator,
        TRAINED,
        feet,
        EstimationLimits(
            scan_ns=SCAN_NS,
            range_end_pf=RANGE_END_PF,
            tare=TareLimits(window_scans=WINDOW),
            contact=ContactLimits(threshold_n=0.03),
            max_age_ns=MAX_AGE_NS,
        ),
        Sensitivity(
            load_n_per_mean_closure=9.0,
            force_sigma_n_per_baseline_error=BASELINE_N,
            force_n_per_closure=np.zeros((1, 9, 3)),
            force_sigma_n_per_reading_noise=np.zeros(3),
        ),
        Flag.SIMULATED,
    )


class Feet:
    """Makes scans of feet whose closures are given, and feeds them to a pipeline."""

    def __init__(
        self,
        n_legs: int = 2,
        stray_pf: float = 0.0,
        estimator: SumOfClosures | None = None,
        **own: Any,
    ) -> None:
        self.estimator = estimator or SumOfClosures()
        self.pipeline = pipeline(self.estimator, n_legs, stray_pf, **own)
        self.n_legs = n_legs
        self.stray_pf = stray_pf
        self.sequence = 0
        self.outcomes: list[tuple[int, Result, str]] = []

    def scan(self, closure_um: float | NDArray[np.float64] = 0.0) -> CapFrame:
        closures = np.broadcast_to(np.asarray(closure_um, float), (self.n_legs, 9))
        self.sequence += 1
        return CapFrame(
            self.sequence,
            np.full((self.n_legs, 9), self.sequence * SCAN_NS),
            DESIGN.capacitance_pf(closures) + self.stray_pf,
            np.zeros((self.n_legs, 9), np.uint8),
        )

    def feed(self, scan: CapFrame, age_ns: int = 0) -> ContactFrame:
        forces, outcomes = self.pipeline.process(scan, scan.sequence * SCAN_NS + age_ns)
        self.outcomes += [(o.command.leg, o.result, o.reason) for o in outcomes]
        return forces

    def tared(self) -> "Feet":
        for _ in range(WINDOW):
            self.feed(self.scan())
        assert [result for _, result, _ in self.outcomes] == [Result.DONE] * self.n_legs
        self.outcomes.clear()
        return self


def unread(scan: CapFrame, leg: int, *elements: int, reading: Reading = Reading.NOT_READY) -> CapFrame:
    """Take the readings of some elements of a leg away, of all without any named."""
    chosen = list(elements or range(9))
    scan.capacitance_pf[leg, chosen], scan.t_ns[leg, chosen], scan.reading[leg, chosen] = np.nan, 0, reading
    return scan
