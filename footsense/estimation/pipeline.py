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
from footsense.estimation.elements import ConsistencyTest, ElementClassifier
from footsense.estimation.leg_state import LegRecord, LegStates
from footsense.estimation.missing_elements import Imputation, missing_sets_containing, remembered
from footsense.estimation.network import STEADY_AGES_S, Network, ReadingWindow, sensitivity
from footsense.estimation.noise import ReadingNoise
from footsense.estimation.rest import RefinedAtRest
from footsense.estimation.settings import MAX_AGE_SCANS, EstimationLimits, MountedFeet, Sensitivity
from footsense.estimation.walking.gait import GaitTracker
from footsense.foot.network_card import TrainedInputs
from footsense.foot.parameters import variance_factors
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
    LegMotion,
    Mask,
    Result,
    State,
    Vector,
)
from footsense.ports import LoadEstimate, LoadEstimator, Window

#: Largest sigma of a usable force, over the largest force of the training [1]: with a larger one nothing is known.
MAX_SIGMA_REL = 0.5
# Plain number: to store an enumeration's member in an array costs a microsecond.
_OUT_OF_RANGE = np.uint8(State.OUT_OF_RANGE)
#: Standard acceleration of gravity [m/s2].
_GRAVITY_M_PER_S2 = 9.80665
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
        self._max_force_n = trained.max_force_n
        self._max_age_ns = MAX_AGE_SCANS * limits.scan_ns if limits.max_age_ns is None else limits.max_age_ns
        # One per leg: to broadcast a single one takes longer than the operation.
        self._flags = np.full(n_legs, flags, np.uint8)
        self._distance_pf = feet.distance_times_capacitance_pf(design)
        self._imputation = Imputation(trained.moments)
        self._window = ReadingWindow(n_legs, limits.scan_ns)
        self._elements = ElementClassifier(feet, limits.range_end_pf)
        self._noise = ReadingNoise(n_legs, trained.moments)
        self._baselines = BaselineTracker(feet, trained, limits, sensitivity, self._noise)
        self._consistency = ConsistencyTest(n_legs, self._imputation)
        self._leg_states = LegStates()
        self._stopped: Mask = np.zeros(n_legs, bool)
        # Of each leg: a row is as cheap as a value, and to broadcast one is not.
        self._closure_min_rel = np.tile(trained.closure_rel_min, (n_legs, 1))
        self._closure_max_rel = trained.max_usable_closure_rel(feet.gap_um)
        self._trained_rel = [
            np.tile(bound_rel, (len(STEADY_AGES_S), n_legs, 1))
            for bound_rel in (trained.closure_rel_min, trained.closure_rel_max)
        ]
        friction = limits.contact.friction
        self._gait = GaitTracker(n_legs, math.nan if friction is None else friction)
        self._across_rel2, more_along_rel2 = variance_factors(feet.uncertainty)
        self._more_along_rel2 = np.tile(more_along_rel2, 3)
        # Of each leg and element: one that is closed is off by what nobody knows of its gap; slopes at heavy loads.
        gap_rel2 = np.square([unknown.gap_rel for unknown in feet.uncertainty])[:, None, None]
        self._overloaded_n2 = gap_rel2 * np.square(sensitivity.force_n_per_closure[-2:]).mean(axis=0)
        self._set_temperature = set_temperature
        self._own_acceleration = [math.nan] * n_legs

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
        self._stopped[command.leg] = is_stop
        return CommandResult(command, Result.DONE, f"{'stopped' if is_stop else 'started'} by command")

    def set_degraded_timing(self, degraded: bool) -> None:  # noqa: FBT001 - a callback with one value
        """Set or clear the flag `DEGRADED_TIMING` of all legs, from the next frame on."""
        others = self._flags & ~np.uint8(Flag.DEGRADED_TIMING)
        self._flags = others | np.uint8(Flag.DEGRADED_TIMING * degraded)

    def set_temperature(self, temperature_c: Vector) -> None:
        """Set the temperature of each leg's foot [degC], shape (legs,); NaN where not measured."""
        if self._set_temperature is not None:
            self._set_temperature(temperature_c)

    def set_motion(self, motion: LegMotion) -> None:
        """Set the motion of the legs from their gait controller."""
        # By which the foot's own mass pulls: tared, it hangs at rest with the leg upright.
        pulls = np.abs(motion.acceleration_m_per_s2 + _GRAVITY_M_PER_S2 * (motion.up[:, 2] - 1.0))
        self._own_acceleration = np.maximum(pulls - motion.sigma_m_per_s2, 0.0).tolist()

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
        future = scan.t_ns > now_ns
        if np.count_nonzero(future):
            t_ns, pf = np.where(future, 0, scan.t_ns), np.where(future, np.nan, scan.capacitance_pf)
            scan = scan._replace(t_ns=t_ns, capacitance_pf=pf)
        baselines = self._baselines
        elements = self._elements.classify(scan)
        pf = elements.capacitance_pf
        results = baselines.process_tares(scan, elements, self._consistency.excluded, now_ns)
        readings = self._window.add(self._distance_pf / pf, scan.t_ns)
        unloaded = baselines.unloaded
        if not unloaded.complete:
            self._consistency.reset(unloaded.untared_legs)
        unusable = missing_sets_containing(elements.opened, unloaded.untared_elements_of_tared_legs)
        if scan.sequence % _FRAMES_PER_NOISE_MEASUREMENT == 0:
            self._noise.observe(readings.plate_distance_rel)
        closure_rel = baselines.unloaded.plate_distance_rel - readings.plate_distance_rel
        measured_rel = closure_rel[0]
        overloaded = (measured_rel > self._closure_max_rel) | elements.over_range
        consistency = self._consistency
        excluded_before = consistency.excluded
        kept_out, inconsistency_sigma_rel = consistency.test(measured_rel, readings, unusable, overloaded)
        if consistency.excluded is not excluded_before:
            self._window.discard_newest(consistency.excluded > excluded_before)
        missing, incomplete, interrupted, is_interrupted = _with_interrupted_missing(
            kept_out, readings.is_consecutive
        )
        state, fault_mask, cause = self._leg_states.observe(
            LegRecord(
                reading=scan.reading,
                opened=elements.opened,
                over_range=elements.over_range,
                untared=baselines.unloaded.untared_elements_of_tared_legs,
                unusable=unusable,
                excluded=consistency.excluded,
                stuck=consistency.stuck,
                interrupted=interrupted,
                missing=missing,
                overloaded=overloaded,
                below=measured_rel < self._closure_min_rel,
                is_interrupted=is_interrupted,
                is_old=readings.oldest_of_newest_ns < now_ns - self._max_age_ns,
                is_stopped=self._stopped,
                cause=baselines.unloaded.cause,
                untared_states=baselines.tares.states,
            )
        )
        age_s: Vector = (now_ns - readings.t_ns).astype(np.float64) * 1e-9
        load, norms_n2, state = self._estimate_loads(
            closure_rel, age_s, missing, incomplete, inconsistency_sigma_rel, state
        )
        force_n, any_overloaded = load.force_n, np.count_nonzero(overloaded)
        # What a line that breaks adds to the other elements is no load, nor is at least so much a reading in swing.
        if np.count_nonzero(is_interrupted):
            measured_rel[is_interrupted] = np.nan
        if any_overloaded:
            pf = np.where(overloaded, np.nan, pf)
        baselines.observe(
            measured_rel,
            force_n[:, 2],
            load.sigma_n[:, 2],
            pf,
            scan.t_ns,
            readings.newest_ns,
            missing,
            now_ns,
            self._own_acceleration,
        )
        gait = self._gait.observe(load, baselines.contacts, now_ns)
        # Beside the network's: the foot's own mass, and what nobody knows of the foot, along the force and across it.
        variance_n2 = np.square(load.sigma_n) + baselines.swing_variance_n2
        variance_n2 += self._across_rel2 * norms_n2[:, None]
        variance_n2 += self._more_along_rel2 * np.square(force_n)
        if any_overloaded:
            variance_n2 += np.matmul(overloaded[:, None].astype(float), self._overloaded_n2)[:, 0]
        return ContactFrame(
            sequence=scan.sequence,
            t_sent_ns=now_ns,
            t_ns=readings.newest_ns,
            force_n=force_n,
            sigma_n=np.sqrt(variance_n2),
            contact_probability=np.array(self._gait.contact_probability),
            holds=np.array(self._gait.holds),
            state=state,
            fault_mask=fault_mask,
            flags=baselines.flags | self._flags,
            cause=cause,
            noise_ff=baselines.unloaded.noise_ff,
            baseline=baselines.unloaded.drift,
            gait=gait,
        ), results

    def _estimate_loads(
        self,
        closure_rel: Vector,
        age_s: Vector,
        missing: Mask,
        incomplete: list[int],
        inconsistency_sigma_rel: Vector,
        state: Codes,
    ) -> tuple[LoadEstimate, Vector, Codes]:
        """Return the estimated loads (NaN where unusable), their squared norms [N2], and the state of each leg.

        Args:
            closure_rel: Closures over the gap [1], newest first, shape (3, legs, 9).
            age_s: Their ages [s], same shape.
            missing: The elements to do without.
            incomplete: The legs that have some.
            inconsistency_sigma_rel: Sigma by contradicting elements, over the force [1], shape (legs,).
            state: State of each leg by its readings.
        """
        usable, max_n, (min_rel, max_rel) = IS_USABLE_STATE.take(state), self._max_force_n, self._trained_rel
        # The network gets trained inputs only.
        closure_rel = np.minimum(np.maximum(closure_rel, min_rel), max_rel).transpose(1, 0, 2)
        age_s = age_s.transpose(1, 0, 2)
        for leg in incomplete:
            without, ages_s = missing[leg], age_s[leg]
            closure_rel[leg] = self._imputation.impute(closure_rel[leg], without)
            kept_s = ages_s.T[~without]
            ages_s[:, without] = (np.add.reduce(kept_s) / len(kept_s))[:, None]
        unusable = () if np.count_nonzero(usable) == len(usable) else (~usable).nonzero()[0].tolist()
        for leg in unusable:
            closure_rel[leg], age_s[leg] = 0.0, STEADY_AGES_S
        load = self._estimator.estimate(Window(closure_rel, age_s, missing))
        force_n, norms_n2 = load.force_n, np.add.reduce(np.square(load.force_n), axis=1)
        max_sigma_n = MAX_SIGMA_REL * max_n
        sigma_n = np.hypot(load.sigma_n, self._baselines.unloaded.sigma_n)
        if np.count_nonzero(inconsistency_sigma_rel):
            # Which alone never takes a force away.
            inconsistent_n = (inconsistency_sigma_rel * np.sqrt(norms_n2))[:, None]
            sigma_n = np.minimum(np.hypot(sigma_n, inconsistent_n), np.maximum(sigma_n, max_sigma_n))
        # In plain Python numbers: for six legs, arrays take longer. A NaN does not fit.
        fits = [
            n2 <= max_n * max_n and x <= max_sigma_n and y <= max_sigma_n and z <= max_sigma_n
            for n2, (x, y, z) in zip(norms_n2.tolist(), sigma_n.tolist(), strict=True)
        ]
        if unusable or not all(fits):
            are_fit = np.array(fits)
            untold = ~(usable & are_fit)
            state = np.where(usable > are_fit, _OUT_OF_RANGE, state)
            force_n[untold] = sigma_n[untold] = np.nan
        return LoadEstimate(force_n, sigma_n, *load[2:]), norms_n2, state


@remembered
def _with_interrupted_missing(missing: Mask, is_consecutive: Mask) -> tuple[Mask, list[int], Mask, Mask]:
    """Return the missing elements with those without consecutive readings, their legs, the latter, interrupted legs.

    A leg is interrupted until enough of its elements have been read in a row for the network to do without the others.
    """
    all_missing = missing_sets_containing(missing, ~is_consecutive)
    is_interrupted = np.logical_or.reduce(~is_consecutive & ~all_missing, axis=1)
    with_interrupted = np.where(is_interrupted[:, None], missing, all_missing)
    incomplete = np.logical_or.reduce(with_interrupted, axis=1).nonzero()[0].tolist()
    return with_interrupted, incomplete, with_interrupted > missing, is_interrupted


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
