"""Baselines of all legs: tares, drift tracking, and contact detection.

A tare (`tare.py`) gives a baseline: at start without a command, later on command. Between tares the baseline follows
the drift of a foot in swing (`drift.py`); `contact.py` tells swing from stance.
"""

from functools import partial
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from footsense.estimation.contact import ContactDetector, trimmed_means
from footsense.estimation.drift import MAX_DRIFT_PF, LegBaseline, baseline_sigma_pf
from footsense.estimation.sensitivity import Sensitivity
from footsense.estimation.settings import EstimationLimits, MountedFeet
from footsense.estimation.tare import Tares
from footsense.foot.capacitor import CapacitorDesign
from footsense.frames import (
    BaselineDrift,
    BaselineStatus,
    Cause,
    Codes,
    Command,
    CommandKind,
    CommandResult,
    Flag,
    Mask,
    Reading,
    Stamps,
    Vector,
)
from footsense.leg_words import SILENT_READINGS

#: Silence after which a baseline is discarded: the foot may have been swapped (a swap takes longer).
_BASELINE_LOST_AFTER_SILENCE_NS = 250_000_000
#: The same while a line of the leg's bus is stuck, which may be another leg's fault: a robot that stands would lose all
#: its forces until each foot's next swing.
_BASELINE_LOST_AFTER_STUCK_BUS_NS = 3_000_000_000

#: Frames in which every leg gets its turn to follow: two of six legs in one frame, of opposite tripods.
_FRAMES_PER_TRACKING_ROUND = 3

#: Period of the baselines' uncertainty [ns]; in a tenth of a second they drift by a fifth of a fF.
_SIGMA_UPDATE_PERIOD_NS = 100_000_000

#: Largest distance of an element's drift from the mean of its leg's [pF]: all drift by 30 fF over 20 K, and elements
#: differ in that by a fifth.
MAX_DRIFT_FROM_LEG_MEAN_PF = 20e-3

_status_of = attrgetter("status")

# Plain numbers: an enumeration's arithmetic costs a microsecond each time.
_CONTACT, _TARE_REFUSED = int(Flag.CONTACT), int(Flag.TARE_REFUSED)
_HELD, _DRIFT_TOO_FAST = BaselineStatus.HELD, BaselineStatus.DRIFT_TOO_FAST


class UnloadedFeet(NamedTuple):
    """Baselines of all legs with arrays derived from them; replaced when a baseline changes.

    Attributes:
        baseline_pf: Unloaded capacitances without stray [pF], shape (legs, elements), NaN where there is none.
        plate_distance_rel: Plate distances over the gap [1], shape (legs, elements).
        untared_legs: Legs without any baseline, shape (legs,).
        untared_elements_of_tared_legs: Elements without a baseline on legs that have others, shape (legs, elements).
        complete: Whether every element of every leg has a baseline.
    """

    baseline_pf: Vector
    plate_distance_rel: Vector
    untared_legs: Mask
    untared_elements_of_tared_legs: Mask
    complete: bool


class BaselineTracker:
    """Baselines and contact detectors of all legs, and the tares in progress.

    Every leg is tared at start, repeatedly until that succeeds.

    Args:
        feet: The feet.
        design: The capacitors.
        limits: Limits of tare and contact, and whether baselines follow a foot in swing.
        sensitivity: Forces per closure.

    Attributes:
        contacts: Contact of each leg.
        tares: Tares in progress.
        unloaded: The baselines, and what follows from them; replaced, never written to.
        sigma_n: Standard deviation of each leg's force by its baseline [N], shape (legs, 3), NaN without one.
        flags: CONTACT, and TARE_REFUSED where an older baseline is in use, shape (legs,).
        drift: Published status and drift.
        drift_cause: Cause of each leg by its drift, shape (legs,): ELEMENT_DRIFTS where an element drifts unlike the
            others, else NONE.
    """

    def __init__(
        self, feet: MountedFeet, design: CapacitorDesign, limits: EstimationLimits, sensitivity: Sensitivity
    ) -> None:
        unloaded_pf, n_legs = feet.unloaded_pf, len(feet.names)
        self._design = design
        self._gain_rel = feet.gain_rel
        self.tares = Tares(limits.tare, feet)
        self._sensitivity = sensitivity
        self._track = limits.track_baseline
        self._contact = partial(ContactDetector, limits.least_contact_n, limits.max_swing_rise_n_per_s)
        self._baselines = [LegBaseline(leg_pf, limits.tare) for leg_pf in unloaded_pf]
        self.contacts = [self._contact() for _ in unloaded_pf]
        # Near the unloaded distance, where the error of a baseline matters.
        self._closure_per_pf = float(design.plate_distance_um(unloaded_pf).mean()) / (
            design.gap_um * float(unloaded_pf.mean())
        )
        self._turn = 0
        self._heard_ns = np.zeros(n_legs, np.int64)
        self.sigma_n = np.full((n_legs, 3), np.nan)
        self.flags = np.zeros(n_legs, np.uint8)
        self.drift = BaselineDrift.none(n_legs)
        self._flags: list[int] = []
        self._max_errors_n: list[float] = []
        self._swinging: list[int] = []
        self._copy_changed_baselines()

    def process_tares(
        self, capacitance_pf: Vector, reading: Codes, t_ns: Stamps, unusable: Mask, now_ns: int
    ) -> tuple[CommandResult, ...]:
        """Add a frame of all legs to the tares in progress; return the results of those that finish with it.

        Args:
            capacitance_pf: Readings without stray [pF], shape (legs, elements), NaN where there is none to be used.
            reading: How each element answered, same shape.
            t_ns: Stamp of each [ns], same shape.
            unusable: Elements to leave out, same shape.
            now_ns: Current time [ns].
        """
        if np.count_nonzero(reading):
            self._retare_silent_legs(reading, now_ns)
        else:
            self._heard_ns.fill(now_ns)
        results = []
        tares = self.tares
        ended = tares.add(capacitance_pf, reading, t_ns, unusable) if tares.in_progress else ()
        for leg, tared, is_news in ended:
            if tared.baseline_pf is not None:
                tared_ns = int(t_ns[leg].max())
                self._baselines[leg].set_tared(tared.baseline_pf, tared_ns)
                self.contacts[leg].reset(tared_ns)
                self._copy_changed_baselines()
            if is_news:
                results.append(CommandResult(Command(CommandKind.TARE, leg), tared.result, tared.reason))
        if now_ns >= self._sigma_due_ns:
            self._update_sigma(now_ns)
        return tuple(results)

    def observe(
        self,
        closure_rel: Vector,
        predicted_n: Vector,
        capacitance_pf: Vector,
        t_ns: Stamps,
        missing: Mask,
        now_ns: int,
    ) -> None:
        """Detect contact, and update the baselines of legs in swing.

        Args:
            closure_rel: Measured closures over the gap [1], shape (legs, elements), NaN where there is none.
            predicted_n: Force along each leg as of now, from the last readings [N], shape (legs,), NaN for none.
            capacitance_pf: Readings without stray that they come from [pF], same shape.
            t_ns: Stamp of each [ns], same shape.
            missing: Elements that the network does without, same shape.
            now_ns: Current time [ns].
        """
        if np.count_nonzero(missing):
            closure_rel = np.where(missing, np.nan, closure_rel)
        means_rel = trimmed_means(closure_rel)
        newest_ns = np.maximum.reduce(t_ns, axis=1).tolist()
        swung, swinging = self._swinging, []
        flags = []
        n_per_rel, track = self._sensitivity.load_n_per_mean_closure, self._track
        refused, untared = self.tares.refused, self.tares.untared
        legs = zip(
            self._baselines,
            self.contacts,
            means_rel,
            self._max_errors_n,
            newest_ns,
            predicted_n.tolist(),
            strict=True,
        )
        for leg, (baseline, contact, mean_rel, error_n, newest, leg_predicted_n) in enumerate(legs):
            contact.observe(mean_rel * n_per_rel, error_n, newest, now_ns, leg_predicted_n)
            in_contact = contact.in_contact
            flag = _CONTACT if in_contact else 0
            flags.append(flag | _TARE_REFUSED if leg in refused else flag)
            if leg in untared:
                continue
            if in_contact or not (track and contact.in_swing):
                held = _HELD
            elif not contact.explained_by_drift:
                held = _DRIFT_TOO_FAST
            else:
                swinging.append(leg)
                continue
            if leg in swung or baseline.status is not held:
                baseline.pause_tracking(held)
        self._swinging = swinging
        self._track_drift(capacitance_pf, t_ns, missing)
        if flags != self._flags:
            self._flags, self.flags = flags, np.array(flags, np.uint8)

    def _track_drift(self, capacitance_pf: Vector, t_ns: Stamps, missing: Mask) -> None:
        """Update the baselines of those legs in swing whose turn it is; arguments as of `observe`."""
        self._turn = (self._turn + 1) % _FRAMES_PER_TRACKING_ROUND
        moved = False
        for leg in self._swinging:
            if leg % _FRAMES_PER_TRACKING_ROUND == self._turn:
                baseline = self._baselines[leg]
                # An element that is missing only for want of a baseline gets one.
                ignored = missing[leg] & np.isfinite(baseline.baseline_pf)
                moved |= baseline.track_drift(np.where(ignored, np.nan, capacitance_pf[leg]), t_ns[leg])
        if moved:
            self._copy_changed_baselines()
        elif (statuses := list(map(_status_of, self._baselines))) != self.drift.status.tolist():
            self.drift = self.drift._replace(status=np.array(statuses, np.uint8))

    def _update_sigma(self, now_ns: int) -> None:
        # Of the coming period, which ends at a time that does not depend on the legs.
        self._sigma_due_ns = (now_ns // _SIGMA_UPDATE_PERIOD_NS + 1) * _SIGMA_UPDATE_PERIOD_NS
        sigma_pf = baseline_sigma_pf(self._variance_pf2, self._updated_ns, self._sigma_due_ns)
        n_per_pf = self._closure_per_pf * self._sensitivity.load_n_per_mean_closure
        self._max_errors_n = [n_per_pf * min(3.0 * sigma, MAX_DRIFT_PF) for sigma in sigma_pf.tolist()]
        self.sigma_n = np.outer(
            sigma_pf * self._closure_per_pf, self._sensitivity.force_sigma_n_per_baseline_error
        )

    def _copy_changed_baselines(self) -> None:
        self._sigma_due_ns = 0
        legs = self._baselines
        baseline_pf = np.array([leg.baseline_pf for leg in legs])
        without_baseline: Mask = np.isnan(baseline_pf)
        untared_legs: Mask = np.asarray(without_baseline.all(axis=1))
        self.unloaded = UnloadedFeet(
            baseline_pf=baseline_pf,
            plate_distance_rel=self._design.plate_distance_um(baseline_pf)
            / self._design.gap_um
            / self._gain_rel,
            untared_legs=untared_legs,
            untared_elements_of_tared_legs=without_baseline & ~untared_legs[:, None],
            complete=not without_baseline.any(),
        )
        self._variance_pf2 = np.array([leg.variance_pf2 for leg in legs])
        self._updated_ns = np.array([leg.updated_ns for leg in legs], np.int64)
        mean_pf, worst_pf = np.array([leg.offset_pf for leg in legs]).T.copy()
        self.drift = BaselineDrift(
            np.array(list(map(_status_of, legs)), np.uint8),
            mean_pf,
            worst_pf,
            np.array([leg.moved_ns for leg in legs], np.int64),
        )
        apart = np.abs(worst_pf - mean_pf) > MAX_DRIFT_FROM_LEG_MEAN_PF
        self.drift_cause = np.where(apart, np.uint8(Cause.ELEMENT_DRIFTS), np.uint8(Cause.NONE))

    def _retare_silent_legs(self, reading: Codes, now_ns: int) -> None:
        """Discard the baseline of every leg silent for too long, and start a new tare of it."""
        silent = np.isin(reading, SILENT_READINGS).all(axis=1)
        self._heard_ns[~silent] = now_ns
        stuck = (reading == Reading.BUS_STUCK).any(axis=1)
        allowed_ns = np.where(stuck, _BASELINE_LOST_AFTER_STUCK_BUS_NS, _BASELINE_LOST_AFTER_SILENCE_NS)
        for leg in np.flatnonzero(now_ns - self._heard_ns >= allowed_ns).tolist():
            if leg not in self.tares.untared:
                self.tares.restart(leg)
                self._baselines[leg].discard()
                self.contacts[leg] = self._contact()
                self._copy_changed_baselines()
