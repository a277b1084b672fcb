"""From readings to forces: stray and baseline removed, gap closures normalised, one network call for all legs.

A leg whose value may not be used gets a state that says why, and NaN instead of a force. What one force is made of, a
whole scan or the newest element and a prediction of the others, is a `Reckoning`'s matter.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from footsense.core import quality
from footsense.core.consistency import Consistency
from footsense.core.contact import ContactLimits
from footsense.core.design import CapacitorDesign
from footsense.core.footing import Footing
from footsense.core.ganged import Ganged
from footsense.core.scan_by_scan import Moment
from footsense.core.sensitivity import Sensitivity
from footsense.core.tare import TareLimits
from footsense.frames import (
    ELEMENTS,
    USABLE,
    CapFrame,
    Command,
    CommandKind,
    Flag,
    ForceFrame,
    Outcome,
    Reading,
    Result,
    State,
)

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Looked up by state: to search the few usable ones for each leg costs ten times as much.
_USABLE = np.isin(np.arange(256), sorted(USABLE))


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """What the network's card says about its inputs and outputs.

    Attributes:
        design: The capacitors that it was trained for.
        closure_rel_min: Smallest trained input of each element [1], shape (9,).
        closure_rel_max: Largest trained input of each element [1], shape (9,).
        moments: Second moments of the closures, for filling in missing ones, shape (9, 9).
    """

    design: CapacitorDesign
    closure_rel_min: Vector
    closure_rel_max: Vector
    moments: Vector


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
        max_age_ns: Age from which a measurement may not be used any more [ns].
        flags: Flags that every frame carries.
        ganged: What is known of the legs that are read column by column; None if none ever is.
    """

    def __init__(
        self,
        reckoning: Reckoning,
        calibration: Calibration,
        stray_pf: Vector,
        unloaded_pf: Vector,
        *,
        sensitivity: Sensitivity,
        tare: TareLimits,
        contact: ContactLimits,
        max_age_ns: int,
        track_zero: bool = True,
        flags: int = 0,
        ganged: Ganged | None = None,
    ) -> None:
        self._reckoning = reckoning
        self._calibration = calibration
        self._stray_pf = stray_pf
        self._unloaded_pf = unloaded_pf
        self._max_age_ns = max_age_ns
        self._flags = flags
        self._ganged = ganged
        n_legs = len(stray_pf)
        self._footing = Footing(unloaded_pf, calibration.design, tare, contact, sensitivity, track=track_zero)
        self._consistency = Consistency(n_legs, calibration.moments, max_age_ns)
        self._no_fault = np.zeros(n_legs, np.uint16)
        self._zero = self._footing.zero
        self._cause = quality.drifting_zeros(self._zero)
        self._none: Mask = np.zeros((n_legs, ELEMENTS), bool)
        self._opened = self._none
        self._stopped = np.zeros(n_legs, bool)
        # Beyond either, an element is shut or out of range.
        self._least_rel = calibration.closure_rel_min
        self._most_rel = np.minimum(calibration.closure_rel_max, quality.SHUT_REL)
        self._at_rest = _AtRest(self._footing.baseline_pf, calibration.design)

    @property
    def baseline_pf(self) -> Vector:
        """What each element reads unloaded, without stray [pF], shape (legs, 9), NaN where that is not known."""
        return self._footing.baseline_pf

    @property
    def to_gang(self) -> Mask | None:
        """Which legs are to be read column by column from now on, shape (legs,); None if none ever is."""
        return None if self._ganged is None else self._ganged.wanted

    def obey(self, command: Command) -> Outcome | None:
        """Begin what a command asks for, unless the foot is on the ground; a tare ends in a later scan."""
        if command.kind is CommandKind.TARE:
            return self._footing.begin(command.leg)
        reason = self._footing.refusal(command.kind, command.leg)
        if reason is not None:
            return Outcome(command, Result.LOADED, reason)
        self._stopped[command.leg] = command.kind is CommandKind.STOP
        return Outcome(command, Result.DONE, f"{command.kind.name.lower()} obeyed")

    def process(self, scan: CapFrame, now_ns: int) -> tuple[ForceFrame, tuple[Outcome, ...]]:
        """Return the forces of a scan as of `now_ns`, and the tares that ended with it."""
        # A code of zero divides by zero; what comes of it is judged like any other reading.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            if self._ganged is None:
                return self._process(scan, now_ns)
            footing, ganged = self._footing, self._ganged
            scan = ganged.stand_in(scan, footing.baseline_pf, self._stray_pf)
            footing.standing_in = ganged.standing_in
            forces, outcomes = self._process(scan, now_ns)
            free = (forces.state == State.VALID) & ~footing.taring & (forces.flags & Flag.CONTACT == 0)
            ganged.decide(footing.aloft, footing.followed, free, now_ns)
            return replace(forces, sigma_n=ganged.widen(forces.sigma_n, forces.force_n)), outcomes

    def _process(self, scan: CapFrame, now_ns: int) -> tuple[ForceFrame, tuple[Outcome, ...]]:
        calibration, footing = self._calibration, self._footing
        seen = self._look(scan)
        outcomes = footing.tare(seen.settled_pf, scan.reading, scan.t_ns, seen.lacking, now_ns)
        if footing.baseline_pf is not self._at_rest.baseline_pf:
            self._at_rest = _AtRest(footing.baseline_pf, calibration.design)
            self._consistency.forget(self._at_rest.untared_legs)
        rest_rel, untared = self._at_rest.distance_rel, self._at_rest.untared
        missing = quality.missing_elements(seen.faulty | untared)
        # Moved to one time as distances, which do not jump when a tare moves the baseline.
        distance_rel = calibration.design.plate_distance_um(seen.settled_pf) / calibration.design.gap_um
        moment = self._reckoning.align(distance_rel, scan.t_ns, now_ns, missing)
        closure_rel, judged_rel = rest_rel - moment.values, rest_rel - moment.judged
        judgement = self._consistency.judge(closure_rel, judged_rel, missing, moment.t_ns)
        # Some are forgiven with this frame, and some are blamed.
        shorted = seen.over_range & (missing | self._consistency.remembered)
        faulty = seen.opened | untared | self._consistency.remembered | (judgement.missing & ~missing)
        missing = judgement.missing
        footing.observe(judged_rel, seen.settled_pf, scan.t_ns, missing, now_ns)

        outside = (judged_rel < self._least_rel) | (judged_rel > self._most_rel)
        shut = outside & (judged_rel > quality.SHUT_REL)
        oldest_ns = scan.t_ns.min(axis=1)
        # Of a robot that is well, no element has to be looked at.
        well = not (faulty.any() or outside.any() or scan.reading.any())
        state = np.full(len(missing), State.VALID, np.uint8)
        state[judgement.doubt_rel > 0.0] = State.DEGRADED
        if not well:
            state[missing.any(axis=1)] = State.DEGRADED
            state[(outside & ~missing).any(axis=1)] = State.OUT_OF_RANGE
        state[(now_ns - oldest_ns > self._max_age_ns) | ~moment.together] = State.STALE
        footing.mark_untared(state)
        if not well:
            wrong, shut_now = faulty & ~missing, shut & ~missing | seen.over_range & ~shorted
            quality.converter_states(state, scan.reading, wrong, shut_now)
        state[self._stopped] = State.STOPPED

        usable = _USABLE[state]
        # A prediction may overshoot, at lift-off for instance; the network is not asked what it was not taught.
        taught_rel = np.minimum(
            np.maximum(closure_rel, calibration.closure_rel_min), calibration.closure_rel_max
        )
        force_n, sigma_n = self._reckoning.estimate(taught_rel, rest_rel, usable, missing)
        sigma_n = np.hypot(sigma_n, footing.sigma_n)
        if judgement.doubt_rel.any():
            doubt_n = judgement.doubt_rel * np.linalg.norm(force_n, axis=1)
            sigma_n = np.hypot(sigma_n, doubt_n[:, None])
        unknown = ~(usable & np.isfinite(force_n + sigma_n).all(axis=1))
        if unknown.any():
            state[unknown & usable] = State.OUT_OF_RANGE
            force_n[unknown] = sigma_n[unknown] = np.nan
        return ForceFrame(
            sequence=scan.sequence,
            t_sent_ns=now_ns,
            t_ns=np.where(oldest_ns > 0, moment.t_ns, 0),
            force_n=force_n,
            sigma_n=sigma_n,
            state=state,
            fault_mask=self._no_fault if well else quality.fault_mask((scan.reading != 0) | faulty | shut),
            flags=footing.flags | np.uint8(self._flags),
            cause=self._drifting_zeros()
            if well
            else quality.causes(
                scan.reading,
                state,
                quality.Faulty(seen.opened, shorted, judgement.stuck, judgement.drifting),
                footing.zero,
            ),
            zero=footing.zero,
        ), outcomes

    def _drifting_zeros(self) -> NDArray[np.uint8]:
        """Return the causes of a robot that is well, shape (legs,): zeros may have parted all the same."""
        if self._zero is not self._footing.zero:
            self._zero = self._footing.zero
            self._cause = quality.drifting_zeros(self._zero)
        return self._cause

    def _look(self, scan: CapFrame) -> "_Seen":
        """Tell which readings may be used, before anything is known of loads."""
        none = self._none
        capacitance_pf = scan.capacitance_pf - self._stray_pf
        # NaN compares as False: an element that was not read is neither open, shut nor out of range.
        opened = quality.open_elements(capacitance_pf, self._unloaded_pf)
        remembered = self._consistency.remembered
        before, self._opened = self._opened, opened
        if not (scan.reading.any() or opened.any() or before.any()):
            lacking = quality.missing_elements(remembered)
            return _Seen(capacitance_pf, none, none, remembered, lacking)
        over_range = scan.reading == Reading.OVER_RANGE
        if over_range.any():  # as much at least: whether that may be, the other elements tell
            capacitance_pf = np.where(over_range, quality.RANGE_END_PF - self._stray_pf, capacitance_pf)
        if opened.any():
            capacitance_pf = capacitance_pf - quality.floating_pf(scan.capacitance_pf, opened)
        # A line that breaks or returns was whole for a part of the scan, and what it does to the other elements too.
        unsettled = opened | (opened != before).any(axis=1, keepdims=True)
        faulty = opened | remembered
        # Whether an element over the range is pressed or shorted, the others' closures tell: none without a baseline.
        lacking = quality.missing_elements(faulty | over_range & np.isnan(self._footing.baseline_pf))
        # What is open or unsettled has none: a line through its last one would take the element's return for a load.
        return _Seen(np.where(unsettled, np.nan, capacitance_pf), opened, over_range, faulty, lacking)


class _Seen(NamedTuple):
    """What a frame's readings are worth by themselves, shape (legs, 9) each.

    Attributes:
        settled_pf: Capacitances without stray [pF], NaN where there is none to be used.
        opened: Elements that have lost their electrode.
        over_range: Elements that read more than the converter can.
        faulty: Those that are open, and those that contradicted the others before.
        lacking: What a tare has to do without.
    """

    settled_pf: Vector
    opened: Mask
    over_range: Mask
    faulty: Mask
    lacking: Mask


class _AtRest:
    """What follows from the baselines; they change seldom.

    Args:
        baseline_pf: Unloaded capacitances without stray [pF], shape (legs, 9), NaN where there is none.
        design: The capacitors.

    Attributes:
        baseline_pf: As given.
        distance_rel: Distances over the gap [1], shape (legs, 9).
        untared_legs: Legs without any, shape (legs,).
        untared: Elements without one on legs that have others, shape (legs, 9).
    """

    def __init__(self, baseline_pf: Vector, design: CapacitorDesign) -> None:
        self.baseline_pf = baseline_pf
        self.distance_rel = design.plate_distance_um(baseline_pf) / design.gap_um
        untared: Mask = np.isnan(baseline_pf)
        whole_legs: Mask = np.asarray(untared.all(axis=1))
        self.untared_legs = whole_legs
        self.untared: Mask = np.logical_and(untared, ~whole_legs[:, None])
