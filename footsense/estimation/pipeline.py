"""From readings to forces: stray and baseline removed, gap closures normalised, one network call for all legs.

A leg whose value may not be used gets a state that says why, and NaN instead of a force. What one force is made of, a
whole scan or the newest element and a prediction of the others, is a `Reckoning`'s matter.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.alignment.scan_by_scan import Moment
from footsense.estimation.baseline.contact import ContactLimits
from footsense.estimation.baseline.tare import TareLimits
from footsense.estimation.baseline.tracker import Footing
from footsense.estimation.baseline.unloaded import AtRest
from footsense.estimation.faults import leg_status
from footsense.estimation.faults.calibration_monitor import Ageing
from footsense.estimation.faults.consistency import Consistency, Judgement
from footsense.estimation.faults.element_status import Readings, Seen
from footsense.estimation.sensitivity import Sensitivity
from footsense.foot.network_card import TrainedInputs
from footsense.frames import (
    USABLE,
    CapFrame,
    Cause,
    Command,
    CommandKind,
    CommandResult,
    ContactFrame,
    Flag,
    Result,
    State,
)

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

_CONTACT = np.uint8(Flag.CONTACT)

#: Looked up by state: to search the few usable ones for each leg costs ten times as much.
_USABLE = np.isin(np.arange(256), sorted(USABLE))


class Reckoning(Protocol):
    """How readings that were taken one after the other become forces of one time: `ScanByScan`, `ElementByElement`."""

    def align(self, values: Vector, t_ns: NDArray[np.int64], now_ns: int, missing: Mask) -> Moment:
        """Bring the elements of each leg to one time."""
        ...

    def estimate(
        self, closure_rel: Vector, rest_rel: Vector, usable: Mask, missing: Mask
    ) -> tuple[Vector, Vector]:
        """Return force and sigma of what was aligned last [N], shape (legs, 3) each."""
        ...


class Pipeline:
    """Turns scans into forces, and keeps each leg's baseline.

    Args:
        reckoning: What makes forces of closures.
        calibration: What its card says.
        stray_pf: Known capacitance in parallel with each element [pF], shape (legs, 9).
        unloaded_pf: What each element of the free foot is expected to read, without stray [pF], shape (legs, 9).
        sensitivity: What small closures are worth in newtons.
        tare: When a tare is granted.
        contact: When a foot is on the ground.
        track_zero: Whether a baseline follows a foot in the air.
        max_age_ns: Age of the oldest reading from which a measurement may not be used any more [ns].
        settled_ns: Time after which readings from before a step are forgotten: a few scans [ns].
        flags: Flags that every frame carries.
        range_end_pf: What an element over the converter's range has at least [pF].
        gap_um: Air gap of each element [um], shape (legs, 9); None for the design's.
        gain_rel: Closure of each element by the design's electrodes, of its real closure [1], shape (legs, 9); None for
            1. What all parts of the pipeline see are real closures, over the design's gap.
        feet: Name of the foot on each leg whose fingerprint `unloaded_pf` is; empty where it is any foot's.
        body_weight_n: What all legs carry together [N]; None if that is not known.
        warm: Is told the temperature of each leg's foot [degC], shape (legs,), NaN where nothing measures it; None if
            that is of no use.
    """

    def __init__(
        self,
        reckoning: Reckoning,
        calibration: TrainedInputs,
        stray_pf: Vector,
        unloaded_pf: Vector,
        *,
        sensitivity: Sensitivity,
        tare: TareLimits,
        contact: ContactLimits,
        max_age_ns: int,
        settled_ns: int,
        track_zero: bool = True,
        flags: int = 0,
        range_end_pf: float = leg_status.RANGE_END_PF,
        gap_um: Vector | None = None,
        gain_rel: Vector | None = None,
        feet: Sequence[str] = (),
        body_weight_n: float | None = None,
        warm: Callable[[Vector], None] | None = None,
    ) -> None:
        self._reckoning = reckoning
        self._calibration = calibration
        self._stray_pf = stray_pf
        self._max_age_ns = max_age_ns
        self._flags = np.uint8(flags)
        n_legs = len(stray_pf)
        # A capacitor of the electrodes' area with the gap between them: over a capacitance, its distance over the gap.
        designed_pf = calibration.design.plate_distance_um(np.ones(1)) / calibration.design.gap_um
        self._gain_rel = np.ones_like(stray_pf) if gain_rel is None else gain_rel
        self._gap_pf = designed_pf / self._gain_rel
        self._warm = warm
        self._footing = Footing(
            unloaded_pf, calibration.design, tare, contact, sensitivity, track=track_zero, feet=feet
        )
        self._consistency = Consistency(n_legs, calibration.moments, settled_ns)
        self._ageing = Ageing(n_legs, body_weight_n)
        # Of a robot that is well; never written to.
        self._no_fault = np.zeros(n_legs, np.uint16)
        self._all_valid = np.full(n_legs, State.VALID, np.uint8)
        self._every_leg = np.ones(n_legs, bool)
        self._zero = self._footing.zero
        self._cause = leg_status.drifting_zeros(self._zero)
        self._readings = Readings(stray_pf, unloaded_pf, range_end_pf)
        self._stopped = np.zeros(n_legs, bool)
        self._any_stopped = False
        # Beyond either, an element is shut or out of range.
        self._least_rel = calibration.closure_rel_min
        own_um = np.full_like(stray_pf, calibration.design.gap_um) if gap_um is None else gap_um
        self._shut_rel = calibration.gap_closed_rel(own_um)
        self._most_rel = calibration.closure_limit_rel(own_um)
        self._at_rest = AtRest(self._footing.baseline_pf, calibration.design, self._gain_rel)

    @property
    def baseline_pf(self) -> Vector:
        """What each element reads unloaded, without stray [pF], shape (legs, 9), NaN where that is not known."""
        return self._footing.baseline_pf

    def obey(self, command: Command) -> CommandResult | None:
        """Begin what a command asks for, unless the foot is on the ground; a tare ends in a later scan."""
        if command.kind is CommandKind.TARE:
            return self._footing.begin(command.leg)
        reason = self._footing.refusal(command.kind, command.leg)
        if reason is not None:
            return CommandResult(command, Result.LOADED, reason)
        self._stopped[command.leg] = command.kind is CommandKind.STOP
        self._any_stopped = bool(self._stopped.any())
        return CommandResult(command, Result.DONE, f"{command.kind.name.lower()} obeyed")

    def warm(self, temperature_c: Vector) -> None:
        """Take note of the temperature of each leg's foot [degC], shape (legs,), NaN where nothing measures it."""
        if self._warm is not None:
            self._warm(temperature_c)

    # A code of zero divides by zero; what comes of it is judged like any other reading.
    @np.errstate(divide="ignore", invalid="ignore", over="ignore")
    def process(self, scan: CapFrame, now_ns: int) -> tuple[ContactFrame, tuple[CommandResult, ...]]:
        """Return the forces of a scan as of `now_ns`, and the tares that ended with it."""
        calibration, footing = self._calibration, self._footing
        seen = self._readings.look(scan, self._consistency.remembered, footing.baseline_pf)
        outcomes = footing.tare(seen.settled_pf, scan.reading, scan.t_ns, seen.lacking, now_ns)
        if footing.baseline_pf is not self._at_rest.baseline_pf:
            self._at_rest = AtRest(footing.baseline_pf, calibration.design, self._gain_rel)
            self._consistency.forget(self._at_rest.untared_legs)
        rest_rel = self._at_rest.distance_rel
        missing = seen.lacking
        if not (seen.well and self._at_rest.whole):
            missing = leg_status.missing_elements(seen.faulty | self._at_rest.untared)
        # Moved to one time as distances, which do not jump when a tare moves the baseline.
        moment = self._reckoning.align(self._gap_pf / seen.settled_pf, scan.t_ns, now_ns, missing)
        closure_rel = judged_rel = rest_rel - moment.values
        if moment.judged is not moment.values:
            judged_rel = rest_rel - moment.judged
        judgement = self._consistency.judge(closure_rel, judged_rel, missing, moment.t_ns)
        # What is foreseen of a leg that is not together is of no worth.
        foreseen_rel = None
        if judged_rel is not closure_rel:
            foreseen_rel = np.where(moment.together[:, None], closure_rel, np.nan)
        footing.observe(judged_rel, foreseen_rel, seen.settled_pf, scan.t_ns, judgement.missing, now_ns)
        verdict = self._verdict(scan, now_ns, seen, missing, moment, judged_rel, judgement)
        state, usable = verdict.state, verdict.usable

        taught_rel = closure_rel
        if judged_rel is not closure_rel or not verdict.inside:
            # A prediction may overshoot, at lift-off for instance; the network is not asked what it was not taught.
            taught_rel = np.minimum(
                np.maximum(closure_rel, calibration.closure_rel_min), calibration.closure_rel_max
            )
        force_n, sigma_n = self._reckoning.estimate(taught_rel, rest_rel, usable, judgement.missing)
        sigma_n = np.hypot(sigma_n, footing.sigma_n)
        if not judgement.well and judgement.doubt_rel.any():
            doubt_n = judgement.doubt_rel * np.linalg.norm(force_n, axis=1)
            sigma_n = np.hypot(sigma_n, doubt_n[:, None])
        if not (usable is self._every_leg and math.isfinite(np.vdot(force_n, sigma_n))):
            known = usable & np.isfinite(force_n + sigma_n).all(axis=1)
            state = state.copy()
            state[usable & ~known] = State.OUT_OF_RANGE
            force_n[~known] = sigma_n[~known] = np.nan
        if now_ns >= self._ageing.due_ns:
            self._look_for_ageing(force_n, state, judged_rel, now_ns)
        cause = verdict.cause
        if self._ageing.in_doubt:
            unexplained = self._ageing.stale & usable & (cause == Cause.NONE)
            cause = np.where(unexplained, np.uint8(Cause.CALIBRATION_STALE), cause)
        return ContactFrame(
            sequence=scan.sequence,
            t_sent_ns=now_ns,
            t_ns=verdict.t_ns,
            force_n=force_n,
            sigma_n=sigma_n,
            state=state,
            fault_mask=verdict.fault_mask,
            flags=footing.flags | self._flags,
            cause=cause,
            baseline=footing.zero,
        ), outcomes

    def _look_for_ageing(
        self, force_n: Vector, state: NDArray[np.uint8], judged_rel: Vector, now_ns: int
    ) -> None:
        """Let the forces of a frame tell whether the calibrations still hold; of legs in any trouble they do not."""
        load_n = force_n[:, 2]
        if state is not self._all_valid:
            load_n = np.where(state == State.VALID, load_n, np.nan)
        on_ground = self._footing.flags & _CONTACT != 0
        self._ageing.look(load_n, on_ground, self._consistency.squares(judged_rel), now_ns)

    def _verdict(
        self,
        scan: CapFrame,
        now_ns: int,
        seen: Seen,
        missing: Mask,
        moment: Moment,
        judged_rel: Vector,
        judgement: Judgement,
    ) -> "_Verdict":
        """Return what each leg is worth; of a robot that is well, no element and no leg is looked at by itself.

        Args:
            scan: The frame.
            now_ns: The time now [ns].
            seen: What its readings are worth by themselves.
            missing: What was missing before the elements were held against each other.
            moment: What was made of them for one time.
            judged_rel: The closures by which they are judged [1].
            judgement: What they said of each other.
        """
        outside = (judged_rel < self._least_rel) | (judged_rel > self._most_rel)
        inside = not np.count_nonzero(outside)
        oldest_ns = min(moment.oldest_ns.tolist())
        timely = oldest_ns > 0 and now_ns - oldest_ns <= self._max_age_ns
        together = np.count_nonzero(moment.together) == len(moment.together)
        # A leg without a zero has no closures, and so its elements do not agree.
        if seen.well and judgement.well and timely and together and inside and not self._any_stopped:
            return _Verdict(
                self._all_valid, self._every_leg, self._no_fault, self._drifting_zeros(), moment.t_ns, inside
            )
        state = self._all_valid.copy()
        # Some are forgiven with this frame, and some are blamed.
        remembered = self._consistency.remembered
        shorted = seen.over_range & (missing | remembered)
        faulty = seen.opened | self._at_rest.untared | remembered | (judgement.missing & ~missing)
        missing = judgement.missing
        shut = judged_rel > self._shut_rel
        read_ns = moment.oldest_ns
        state[missing.any(axis=1) | (judgement.doubt_rel > 0.0)] = State.DEGRADED
        state[(outside & ~missing).any(axis=1)] = State.OUT_OF_RANGE
        state[(now_ns - read_ns > self._max_age_ns) | ~moment.together] = State.STALE
        self._footing.mark_untared(state)
        state[(state == State.TARING) & ~moment.together] = State.STARTING
        wrong, pressed = faulty & ~missing, shut & ~missing | seen.over_range & ~shorted
        leg_status.converter_states(state, scan.reading, wrong, pressed)
        state[self._stopped] = State.STOPPED
        broken = leg_status.Faulty(seen.opened, shorted, judgement.stuck, judgement.drifting)
        return _Verdict(
            state=state,
            usable=_USABLE[state],
            fault_mask=leg_status.fault_mask((scan.reading != 0) | faulty | shut),
            cause=leg_status.causes(scan.reading, state, broken, self._footing.zero),
            t_ns=np.where(read_ns > 0, moment.t_ns, 0),
            inside=inside,
        )

    def _drifting_zeros(self) -> NDArray[np.uint8]:
        """Return the causes of a robot that is well, shape (legs,): zeros may have parted all the same."""
        if self._zero is not self._footing.zero:
            self._zero = self._footing.zero
            self._cause = leg_status.drifting_zeros(self._zero)
        return self._cause


class _Verdict(NamedTuple):
    """What each leg is worth, shape (legs,) each; as in `ContactFrame`.

    Attributes:
        state: Whether and why its force may be used.
        usable: The former alone.
        fault_mask: Which elements are not usable.
        cause: What lies behind the state.
        t_ns: How far its measurement reaches [ns].
        inside: Whether no element of any leg is shut or out of range.
    """

    state: NDArray[np.uint8]
    usable: Mask
    fault_mask: NDArray[np.uint16]
    cause: NDArray[np.uint8]
    t_ns: NDArray[np.int64]
    inside: bool
