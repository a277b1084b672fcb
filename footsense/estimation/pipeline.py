"""From readings to contact forces, in named stages; see `Pipeline.process`.

A leg whose force must not be used gets a state that says why, and NaN instead of a force. The force is that of the time
of sending: the network sees the last readings of every element with their ages.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from footsense.estimation.baseline.contact import ContactLimits
from footsense.estimation.baseline.tare import TareLimits
from footsense.estimation.baseline.tracker import BaselineTracker
from footsense.estimation.baseline.unloaded import UnloadedFeet
from footsense.estimation.faults.consistency import ConsistencyResult, ConsistencyTest
from footsense.estimation.faults.imputation import Imputation
from footsense.estimation.faults.missing_sets import missing_sets_containing
from footsense.estimation.faults.status import (
    CONVERTER_MAX_PF,
    ElementClassifier,
    ElementStatus,
    LegStateClassifier,
    LegStatus,
)
from footsense.estimation.gait.tracker import GaitTracker
from footsense.estimation.reading_window import Readings, ReadingWindow
from footsense.estimation.sensitivity import Sensitivity
from footsense.estimation.steady_windows import STEADY_AGES_S
from footsense.foot.files.network_card import TrainedInputs
from footsense.frames import (
    CapFrame,
    Codes,
    Command,
    CommandKind,
    CommandResult,
    ContactFrame,
    Mask,
    Result,
    State,
    Vector,
)
from footsense.ports import Estimator, LoadEstimate, Window


class Pipeline:
    """Estimates forces from capacitance frames; stateful: baselines, fault tests, gait.

    Args:
        estimator: The network, for as many rows as there are legs.
        trained: Inputs that the network was trained for.
        stray_pf: Known capacitance in parallel with each element [pF], shape (legs, elements).
        unloaded_pf: Expected reading of each element of the free foot, without stray [pF], shape (legs, elements).
        sensitivity: Forces per closure.
        tare: Limits of a tare.
        contact: Thresholds of contact.
        track_baseline: Whether a baseline follows a foot in swing.
        scan_ns: Time of a scan [ns].
        max_age_ns: Age of the oldest reading from which a measurement is stale [ns].
        settling_time_ns: Time in which a step of the load has passed through all readings: a few scans [ns].
        flags: Flags of every frame.
        range_end_pf: Least capacitance of an element over the converter's range [pF].
        gap_um: Air gap of each element [um], shape (legs, elements); None for the design's.
        gain_rel: Closure of each element by the design's electrodes, over its real closure [1], shape (legs, elements);
            None for 1. All stages use real closures over the design's gap.
        feet: Name of the foot on each leg that `unloaded_pf` was measured on; empty where it is a design value.
        set_temperature: Called with the temperature of each leg's foot [degC], shape (legs,), NaN where it is not
            measured; None if no estimator uses it.
    """

    def __init__(
        self,
        estimator: Estimator,
        trained: TrainedInputs,
        stray_pf: Vector,
        unloaded_pf: Vector,
        *,
        sensitivity: Sensitivity,
        tare: TareLimits,
        contact: ContactLimits,
        scan_ns: int,
        max_age_ns: int,
        settling_time_ns: int,
        track_baseline: bool = True,
        flags: int = 0,
        range_end_pf: float = CONVERTER_MAX_PF,
        gap_um: Vector | None = None,
        gain_rel: Vector | None = None,
        feet: Sequence[str] = (),
        set_temperature: Callable[[Vector], None] | None = None,
    ) -> None:
        n_legs, design = len(stray_pf), trained.design
        self._estimator = estimator
        self._shape = stray_pf.shape
        self._imputation = Imputation(trained.moments)
        self._window = ReadingWindow(n_legs, scan_ns)
        self._trained = trained
        # One per leg: to broadcast a single one takes longer than the operation.
        self._flags = np.full(n_legs, flags, np.uint8)
        # Plate distance over the gap, times capacitance.
        self._distance_pf = design.plate_distance_um(np.ones(1)) / design.gap_um
        if gain_rel is not None:
            self._distance_pf = self._distance_pf / gain_rel
        self._elements = ElementClassifier(stray_pf, unloaded_pf, range_end_pf)
        self._baselines = BaselineTracker(
            unloaded_pf,
            design,
            tare,
            contact,
            sensitivity,
            track=track_baseline,
            gain_rel=gain_rel,
            feet=feet,
        )
        self._consistency = ConsistencyTest(n_legs, trained.moments, settling_time_ns)
        gap_um = np.full_like(stray_pf, design.gap_um) if gap_um is None else gap_um
        self._legs = LegStateClassifier(n_legs, trained, gap_um, max_age_ns)
        self._gait = GaitTracker(n_legs)
        self._no_leg = np.zeros(n_legs, bool)
        self._set_temperature = set_temperature

    @property
    def baseline_pf(self) -> Vector:
        """Baseline of each element, without stray [pF], shape (legs, elements); NaN where unknown."""
        return self._baselines.unloaded.baseline_pf

    def execute(self, command: Command) -> CommandResult | None:
        """Execute a command; return its result, or None for an accepted tare, whose result comes in a later frame."""
        if command.kind is CommandKind.TARE:
            return self._baselines.begin_tare(command.leg)
        reason = self._baselines.refusal(command.kind, command.leg)
        if reason is not None:
            return CommandResult(command, Result.LOADED, reason)
        self._legs.stopped[command.leg] = command.kind is CommandKind.STOP
        return CommandResult(command, Result.DONE, f"{command.kind.name.lower()} executed")

    def set_temperature(self, temperature_c: Vector) -> None:
        """Set the temperature of each leg's foot [degC], shape (legs,); NaN where not measured."""
        if self._set_temperature is not None:
            self._set_temperature(temperature_c)

    # A code of zero divides by zero; the result is tested like any other reading.
    @np.errstate(divide="ignore", invalid="ignore", over="ignore")
    def process(self, scan: CapFrame, now_ns: int) -> tuple[ContactFrame, tuple[CommandResult, ...]]:
        """Return the forces of a frame as of `now_ns`, and the results of the tares that finish with it.

        The stages: element status, tare, last readings, consistency test, leg status, load, contact and drift, gait.

        Raises:
            ValueError: The frame has another number of legs or elements.
        """
        if scan.capacitance_pf.shape != self._shape:
            raise ValueError(f"a frame of {scan.capacitance_pf.shape} readings, here {self._shape}")
        if scan.t_ns.max() > now_ns:
            scan = _without_future_readings(scan, now_ns)
        baselines = self._baselines
        elements = self._elements.classify(scan, self._consistency.excluded, baselines.unloaded.baseline_pf)
        pf = elements.capacitance_pf
        results = baselines.process_tares(pf, scan.reading, scan.t_ns, elements.missing, now_ns)
        unloaded = baselines.unloaded
        readings = self._window.add(self._distance_pf / pf, scan.t_ns)
        missing = self._missing_elements(elements, unloaded)
        closure_rel = unloaded.plate_distance_rel[:, None] - readings.plate_distance_rel
        measured_rel = closure_rel[:, 0]
        consistency = self._consistency.test(
            measured_rel, readings.second_largest_motion_rel, missing, now_ns
        )
        if not consistency.is_all_ok:
            self._window.discard_newest(consistency.missing & ~missing)
        lost = self._no_leg
        if np.count_nonzero(readings.is_consecutive) < readings.is_consecutive.size:
            consistency, lost = _with_interrupted_readings_missing(consistency, readings)
        legs = self._legs.classify(
            scan.reading,
            elements,
            missing,
            readings,
            lost,
            measured_rel,
            consistency,
            unloaded.untared_elements_of_tared_legs,
            baselines.untared_legs,
            baselines.drift_cause,
            now_ns,
        )
        age_s: Vector = np.asarray((now_ns - readings.t_ns) * 1e-9, np.float64)
        load, state = self._estimate_loads(closure_rel, age_s, consistency, legs)
        force_n = load.force_n
        baselines.observe(measured_rel, force_n[:, 2], pf, scan.t_ns, consistency.missing, now_ns)
        gait = self._gait.observe(load, baselines.contacts, now_ns)
        return ContactFrame(
            sequence=scan.sequence,
            t_sent_ns=now_ns,
            t_ns=legs.t_ns,
            force_n=force_n,
            sigma_n=load.sigma_n,
            state=state,
            fault_mask=legs.fault_mask,
            flags=baselines.flags | self._flags,
            cause=legs.cause,
            baseline=baselines.drift,
            gait=gait,
        ), results

    def _missing_elements(self, elements: ElementStatus, unloaded: UnloadedFeet) -> Mask:
        """Return the mask of elements that cannot be used, shape (legs, elements): faulty, excluded, untared."""
        if not unloaded.complete:
            self._consistency.reset(unloaded.untared_legs)
        elif elements.all_readings_ok:
            return elements.missing
        return missing_sets_containing(elements.faulty | unloaded.untared_elements_of_tared_legs)

    def _estimate_loads(
        self, closure_rel: Vector, age_s: Vector, consistency: ConsistencyResult, legs: LegStatus
    ) -> tuple[LoadEstimate, Codes]:
        """Return the estimated loads (NaN where unusable), and the state of each leg.

        Args:
            closure_rel: Closures over the gap [1], newest first, shape (legs, 3, 9).
            age_s: Their ages [s], same shape.
            consistency: The elements to do without.
            legs: Status of the legs.
        """
        if not legs.all_healthy:
            # The network gets trained inputs only.
            closure_rel = np.where(legs.usable[:, None, None], closure_rel, 0.0)
            closure_rel = np.minimum(
                np.maximum(closure_rel, self._trained.closure_rel_min), self._trained.closure_rel_max
            )
            closure_rel = self._imputation.impute(closure_rel, consistency.missing)
            age_s = _with_usual_ages(age_s, legs.usable, consistency.missing)
        load = self._estimator.estimate(Window(closure_rel, age_s, consistency.missing))
        force_n, sigma_n = load.force_n, load.sigma_n
        sigma_n = np.hypot(sigma_n, self._baselines.sigma_n)
        if not consistency.is_all_ok and consistency.inconsistency_sigma_rel.any():
            inconsistent_n = consistency.inconsistency_sigma_rel * np.linalg.norm(force_n, axis=1)
            sigma_n = np.hypot(sigma_n, inconsistent_n[:, None])
        if legs.all_healthy and math.isfinite(np.vdot(force_n, sigma_n)):
            return load._replace(sigma_n=sigma_n), legs.state
        finite = legs.usable & np.isfinite(force_n + sigma_n).all(axis=1)
        force_n[~finite] = sigma_n[~finite] = np.nan
        state = np.where(legs.usable & ~finite, np.uint8(State.OUT_OF_RANGE), legs.state)
        return load._replace(sigma_n=sigma_n), state


def _without_future_readings(scan: CapFrame, now_ns: int) -> CapFrame:
    """Return a frame without the readings whose time stamps are later than `now_ns`."""
    future = scan.t_ns > now_ns
    return scan._replace(
        t_ns=np.where(future, 0, scan.t_ns),
        capacitance_pf=np.where(future, np.nan, scan.capacitance_pf),
    )


def _with_interrupted_readings_missing(
    consistency: ConsistencyResult, readings: Readings
) -> tuple[ConsistencyResult, Mask]:
    """Return the result with elements without consecutive readings added as missing, and the mask of unusable legs.

    A leg is lost, shape (legs,), until enough of its elements have been read in a row for the network to do without the
    others.
    """
    incomplete = ~readings.is_consecutive
    missing = missing_sets_containing(consistency.missing | incomplete)
    interrupted_legs: Mask = np.asarray((incomplete & ~missing).any(axis=1))
    missing[interrupted_legs] = consistency.missing[interrupted_legs]
    return consistency._replace(missing=missing, is_all_ok=False), interrupted_legs


def _with_usual_ages(age_s: Vector, usable: Mask, missing: Mask) -> Vector:
    """Return ages with those of missing elements replaced by the leg's mean, those of unusable legs by usual ones.

    Args:
        age_s: Ages of the readings [s], shape (legs, 3, 9).
        usable: Legs whose force may be used, shape (legs,).
        missing: Missing elements, shape (legs, elements).
    """
    read = ~missing[:, None]
    n_read = np.maximum(read.sum(axis=2, keepdims=True), 1)
    mean_s = np.where(read, age_s, 0.0).sum(axis=2, keepdims=True) / n_read
    return np.where(usable[:, None, None], np.where(read, age_s, mean_s), STEADY_AGES_S)
