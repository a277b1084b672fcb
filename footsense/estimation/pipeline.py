"""From readings to contact forces, in named stages; see `Pipeline.process`.

`pipeline_of` composes them: for the service, a replay, `footsense.Estimator` and the lab's judging.

A leg whose force must not be used gets a state that says why, and NaN instead of a force. The force is that of the time
of sending: the network sees the last readings of every element with their ages.
"""

import math
from collections.abc import Callable

import numpy as np

from footsense.estimation.baseline import BaselineTracker
from footsense.estimation.calibrated_feet import CalibratedFeet
from footsense.estimation.elements import ConsistencyResult, ConsistencyTest, ElementClassifier, ElementStatus
from footsense.estimation.leg_state import LegStateClassifier
from footsense.estimation.missing_elements import Imputation, missing_sets_containing
from footsense.estimation.network import STEADY_AGES_S, Network, Readings, ReadingWindow, sensitivity
from footsense.estimation.noise import ReadingNoise
from footsense.estimation.rest import RefinedAtRest
from footsense.estimation.settings import EstimationLimits, MountedFeet, Sensitivity
from footsense.estimation.walking.gait import FAST_SCAN_LAGS, SLOW_SCAN_LAGS, GaitTracker
from footsense.foot.network_card import TrainedInputs
from footsense.foot.response_table import FootResponse
from footsense.frames import (
    IS_USABLE_STATE,
    CapFrame,
    Codes,
    Command,
    CommandKind,
    CommandResult,
    ContactFrame,
    Flag,
    Mask,
    Result,
    State,
    Vector,
)
from footsense.ports import LoadEstimate, LoadEstimator, Window

#: Largest sigma of a usable force, over the largest force of the training [1]: with a larger one nothing is known.
MAX_SIGMA_REL = 0.5
#: Noise is measured in one of so many frames: a third of a scan of an I2C bus, whose frames have one new reading.
_FRAMES_PER_NOISE_MEASUREMENT = 3


class Pipeline:
    """Estimates forces from capacitance frames; stateful: baselines, fault tests, gait.

    Args:
        estimator: The network, for as many rows as there are legs.
        trained: Inputs that the network was trained for.
        feet: The mounted feet.
        limits: Limits of tare, contact and age, and the time of a scan.
        sensitivity: Forces per closure.
        flags: Flags of every frame, but for `set_degraded_timing`.
        set_temperature: Called with the temperature of each leg's foot [degC], shape (legs,), NaN where it is not
            measured; None if no estimator uses it.
    """

    def __init__(
        self,
        estimator: LoadEstimator,
        trained: TrainedInputs,
        feet: MountedFeet,
        limits: EstimationLimits,
        sensitivity: Sensitivity,
        flags: int = 0,
        set_temperature: Callable[[Vector], None] | None = None,
    ) -> None:
        n_legs, design = len(feet.names), trained.design
        self._estimator = estimator
        self._trained = trained
        self._max_age_ns = limits.effective_max_age_ns
        # One per leg: to broadcast a single one takes longer than the operation.
        self._flags = np.full(n_legs, flags, np.uint8)
        self._distance_pf = feet.distance_times_capacitance_pf(design)
        self._imputation = Imputation(trained.moments)
        self._window = ReadingWindow(n_legs, limits.scan_ns)
        self._elements = ElementClassifier(feet, limits.range_end_pf)
        self._noise = ReadingNoise(n_legs, trained.moments)
        self._baselines = BaselineTracker(feet, trained, limits, sensitivity, self._noise)
        self._consistency = ConsistencyTest(n_legs, self._imputation)
        self._legs = LegStateClassifier(
            trained, feet.gap_um, self._max_age_ns, self._baselines, self._consistency
        )
        # Of healthy legs; shared by their frames and never written to.
        self._valid = np.full(n_legs, State.VALID, np.uint8)
        self._no_fault, self._no_leg = np.zeros(n_legs, np.uint16), np.zeros(n_legs, bool)
        friction = limits.contact.friction
        self._gait = GaitTracker(
            n_legs,
            math.nan if friction is None else friction,
            FAST_SCAN_LAGS if limits.is_fast_scan else SLOW_SCAN_LAGS,
        )
        gain_error_rel = feet.gain_sigma_rel[:, None] * sensitivity.force_error_rel_per_gain_error
        self._gain_variance_rel2 = gain_error_rel**2
        self._set_temperature = set_temperature

    @property
    def baseline_pf(self) -> Vector:
        """Baseline of each element, without stray [pF], shape (legs, elements); NaN where unknown."""
        return self._baselines.unloaded.baseline_pf

    def execute(self, command: Command) -> CommandResult | None:
        """Execute a command; return its result, or None for an accepted tare, whose result comes in a later frame."""
        is_tare = command.kind is CommandKind.TARE
        tares = self._baselines.tares
        reason = self._baselines.contacts[command.leg].refusal(command.kind)
        if reason is not None:
            if is_tare:
                tares.refuse(command.leg)
            return CommandResult(command, Result.LOADED, reason)
        if is_tare:
            tares.command(command.leg)
            return None
        is_stop = command.kind is CommandKind.STOP
        self._legs.stopped[command.leg] = is_stop
        return CommandResult(command, Result.DONE, f"{'stopped' if is_stop else 'started'} by command")

    def set_degraded_timing(self, degraded: bool) -> None:  # noqa: FBT001 - a callback with one value
        """Set or clear the flag `DEGRADED_TIMING` of all legs, from the next frame on."""
        others = self._flags & ~np.uint8(Flag.DEGRADED_TIMING)
        self._flags = others | np.uint8(Flag.DEGRADED_TIMING * degraded)

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
        if scan.capacitance_pf.shape != self._distance_pf.shape:
            raise ValueError(
                f"a frame of {scan.capacitance_pf.shape} readings, here {self._distance_pf.shape}"
            )
        if scan.t_ns.max() > now_ns:
            scan = _without_future_readings(scan, now_ns)
        baselines = self._baselines
        elements = self._elements.classify(scan, self._consistency.excluded, baselines.unloaded.baseline_pf)
        pf = elements.capacitance_pf
        results = baselines.process_tares(pf, scan.reading, scan.t_ns, elements.unusable, now_ns)
        readings = self._window.add(self._distance_pf / pf, scan.t_ns)
        unusable = self._unusable(elements)
        if scan.sequence % _FRAMES_PER_NOISE_MEASUREMENT == 0:
            self._noise.observe(readings.plate_distance_rel)
        closure_rel = baselines.unloaded.plate_distance_rel[:, None] - readings.plate_distance_rel
        measured_rel = closure_rel[:, 0]
        overloaded = measured_rel > self._legs.closure_max_rel
        if not elements.all_readings_ok:
            overloaded |= elements.over_range
        excluded_before = self._consistency.excluded
        consistency = self._consistency.test(measured_rel, readings, unusable, overloaded)
        self._window.discard_newest(self._consistency.excluded & ~excluded_before)
        interrupted = self._no_leg
        if np.count_nonzero(readings.is_consecutive) < readings.is_consecutive.size:
            consistency, interrupted = _with_interrupted_readings_missing(consistency, readings)
        state, fault_mask, cause = self._valid, self._no_fault, baselines.unloaded.cause
        healthy = self._are_healthy(elements, consistency, overloaded, readings, measured_rel, now_ns)
        if not healthy:
            state, fault_mask, cause = self._legs.classify(
                scan.reading,
                elements,
                unusable,
                consistency.missing,
                overloaded,
                interrupted,
                measured_rel,
                readings,
                now_ns,
            )
        age_s: Vector = np.asarray((now_ns - readings.t_ns) * 1e-9, np.float64)
        load, state = self._estimate_loads(closure_rel, age_s, consistency, state, healthy=healthy)
        force_n = load.force_n
        if interrupted is not self._no_leg or np.count_nonzero(overloaded):
            # What a line that breaks adds to the other elements is no load, nor is at least so much a reading in swing.
            measured_rel = np.where(interrupted[:, None], np.nan, measured_rel)
            pf = np.where(overloaded, np.nan, pf)
        baselines.observe(
            measured_rel, force_n[:, 2], load.sigma_n[:, 2], pf, scan.t_ns, consistency.missing, now_ns
        )
        gait = self._gait.observe(load, baselines.contacts, now_ns)
        # Beside the network's: the foot's own mass, and gains of the elements that nobody has found.
        variance_n2 = load.sigma_n**2 + baselines.swing_sigma_n**2
        variance_n2 += self._gain_variance_rel2 * np.einsum("li,li->l", force_n, force_n)[:, None]
        return ContactFrame(
            sequence=scan.sequence,
            t_sent_ns=now_ns,
            t_ns=readings.newest_ns,
            force_n=force_n,
            sigma_n=np.sqrt(variance_n2),
            state=state,
            fault_mask=fault_mask,
            flags=baselines.flags | self._flags,
            cause=cause,
            noise_ff=baselines.unloaded.noise_ff,
            baseline=baselines.unloaded.drift,
            gait=gait,
        ), results

    def _unusable(self, elements: ElementStatus) -> Mask:
        """Return the sets of elements that the network does without, whatever the test finds."""
        unloaded = self._baselines.unloaded
        if not unloaded.complete:
            self._consistency.reset(unloaded.untared_legs)
        return missing_sets_containing(elements.opened | unloaded.untared_elements_of_tared_legs)

    def _are_healthy(
        self,
        elements: ElementStatus,
        consistency: ConsistencyResult,
        overloaded: Mask,
        readings: Readings,
        measured_rel: Vector,
        now_ns: int,
    ) -> bool:
        # A leg without a baseline has no closures.
        known = readings.is_consecutive & ~(consistency.missing | overloaded) & np.isfinite(measured_rel)
        if not elements.all_readings_ok or np.count_nonzero(known) < known.size:
            return False
        legs = self._legs
        oldest_ns = min(readings.oldest_of_newest_ns.tolist())
        return (
            oldest_ns > 0
            and now_ns - oldest_ns <= self._max_age_ns
            and not np.count_nonzero(measured_rel < legs.closure_min_rel)
            and not np.count_nonzero(legs.stopped)
        )

    def _estimate_loads(
        self,
        closure_rel: Vector,
        age_s: Vector,
        consistency: ConsistencyResult,
        state: Codes,
        *,
        healthy: bool,
    ) -> tuple[LoadEstimate, Codes]:
        """Return the estimated loads (NaN where unusable), and the state of each leg.

        Args:
            closure_rel: Closures over the gap [1], newest first, shape (legs, 3, 9).
            age_s: Their ages [s], same shape.
            consistency: The elements to do without.
            state: State of each leg by its readings.
            healthy: Whether every leg is valid without any fault.
        """
        if not healthy:
            # The network gets trained inputs only.
            usable = IS_USABLE_STATE[state]
            closure_rel = np.where(usable[:, None, None], closure_rel, 0.0)
            closure_rel = np.minimum(
                np.maximum(closure_rel, self._trained.closure_rel_min), self._trained.closure_rel_max
            )
            closure_rel = self._imputation.impute(closure_rel, consistency.missing)
            age_s = _with_usual_ages(age_s, usable, consistency.missing)
        load = self._estimator.estimate(Window(closure_rel, age_s, consistency.missing))
        force_n, sigma_n = load.force_n, load.sigma_n
        sigma_n = np.hypot(sigma_n, self._baselines.unloaded.sigma_n)
        max_n, max_sigma_n = self._trained.max_force_n, MAX_SIGMA_REL * self._trained.max_force_n
        if np.count_nonzero(consistency.inconsistency_sigma_rel):
            sigma_n = with_inconsistency(sigma_n, consistency.inconsistency_sigma_rel, force_n, max_sigma_n)
        # Of all legs together, in few calls: what is within it is so leg by leg. A NaN is never.
        if (
            healthy
            and np.vdot(force_n, force_n) <= max_n * max_n
            and np.vdot(sigma_n, sigma_n) <= max_sigma_n * max_sigma_n
        ):
            return load._replace(sigma_n=sigma_n), state
        usable = IS_USABLE_STATE[state]
        told = usable & (np.linalg.norm(force_n, axis=1) <= max_n) & (sigma_n <= max_sigma_n).all(axis=1)
        force_n[~told] = sigma_n[~told] = np.nan
        state = np.where(usable & ~told, np.uint8(State.OUT_OF_RANGE), state)
        return load._replace(sigma_n=sigma_n), state


def with_inconsistency(
    sigma_n: Vector, inconsistency_sigma_rel: Vector, force_n: Vector, max_sigma_n: float
) -> Vector:
    """Return sigma [N], shape (legs, 3), with the part for residuals, which alone never takes a force away.

    Args:
        sigma_n: Sigma without it [N], same shape.
        inconsistency_sigma_rel: That part over the force [1], shape (legs,).
        force_n: The forces [N], shape (legs, 3).
        max_sigma_n: Largest sigma of a usable force [N].
    """
    inconsistent_n = (inconsistency_sigma_rel * np.linalg.norm(force_n, axis=1))[:, None]
    widened_n: Vector = np.minimum(np.hypot(sigma_n, inconsistent_n), np.maximum(sigma_n, max_sigma_n))
    return widened_n


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
    """Return the result with elements without consecutive readings added as missing, and the interrupted legs.

    A leg is interrupted until enough of its elements have been read in a row for the network to do without the others.
    """
    incomplete = ~readings.is_consecutive
    missing = missing_sets_containing(consistency.missing | incomplete)
    interrupted_legs: Mask = np.asarray((incomplete & ~missing).any(axis=1))
    missing[interrupted_legs] = consistency.missing[interrupted_legs]
    return consistency._replace(missing=missing), interrupted_legs


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


def pipeline_of(
    network: Network,
    feet: MountedFeet,
    limits: EstimationLimits,
    response: FootResponse | None,
    *,
    estimator: LoadEstimator | None = None,
    flags: int = 0,
) -> Pipeline:
    """Return the one composition of the estimation, from capacitances to forces.

    Args:
        network: The network, for as many rows as there are feet.
        feet: The mounted feet.
        limits: How they are read, and what is configured.
        response: Response table of their type, by which loads at rest are refined; None if they are not to be.
        estimator: What gives the loads in place of the network; None for the network itself.
        flags: Flags of every frame, as in `Flag`.
    """
    trained, n_feet = network.card.trained_inputs, len(feet.names)
    force_sensitivity = sensitivity(network, n_feet, trained.moments)
    loads: LoadEstimator = network if estimator is None else estimator
    if response is not None:
        loads = RefinedAtRest(loads, response, trained, n_feet)
    if all(foot is None for foot in feet.parameters):
        return Pipeline(loads, trained, feet, limits, force_sensitivity, flags)
    calibrated = CalibratedFeet(loads, feet.parameters, feet.calibrated_at_c)
    calibrated.set_temperature(np.full(n_feet, np.nan))
    return Pipeline(calibrated, trained, feet, limits, force_sensitivity, flags, calibrated.set_temperature)
