"""Baselines and contacts of all legs: tares in progress, and in swing the tracking of each baseline."""

import math
from collections.abc import Sequence
from functools import partial
from operator import attrgetter

import numpy as np

from footsense.estimation.drift import MAX_DRIFT_PF_PER_S, UnloadedFeet, load_n_per_pf
from footsense.estimation.elements import ElementStatus
from footsense.estimation.missing_elements import missing_sets_containing, trimmed_means
from footsense.estimation.noise import ReadingNoise
from footsense.estimation.settings import SIGMAS, EstimationLimits, MountedFeet, Sensitivity
from footsense.estimation.tare import Tares
from footsense.estimation.walking.contact import ContactDetector
from footsense.foot.network_card import TrainedInputs
from footsense.frames import BaselineStatus, CapFrame, CommandKind, CommandResult, Flag, Mask, Stamps, Vector

#: Frames in which every leg gets its turn to follow: two of six legs in one frame, of opposite tripods.
_FRAMES_PER_TRACKING_ROUND = 3

_status_of = attrgetter("status")
# Plain numbers: an enumeration's arithmetic costs a microsecond each time.
_CONTACT, _TARE_REFUSED = int(Flag.CONTACT), int(Flag.TARE_REFUSED)
_HELD, _DRIFT_TOO_FAST = BaselineStatus.HELD, BaselineStatus.DRIFT_TOO_FAST


class BaselineTracker:
    """Baselines and contact detectors of all legs, and the tares in progress.

    Every leg is tared at start, repeatedly until that succeeds.

    Args:
        feet: The feet.
        trained: Inputs that the network was trained for.
        limits: Limits of tare and contact, and whether baselines follow a foot in swing.
        sensitivity: Forces per closure.
        noise: Noise of each leg's readings.

    Attributes:
        contacts: Contact of each leg.
        tares: Tares in progress.
        unloaded: The baselines, and what follows from them.
        flags: CONTACT, and TARE_REFUSED where an older baseline is in use, shape (legs,).
        swing_variance_n2: Square of the force that is none of the ground, shape (legs, 1) [N2]: what a foot in the air
            reads, and one on the ground below the baseline. A foot can be pressed, not pulled.
    """

    def __init__(
        self,
        feet: MountedFeet,
        trained: TrainedInputs,
        limits: EstimationLimits,
        sensitivity: Sensitivity,
        noise: ReadingNoise,
    ) -> None:
        self.unloaded = UnloadedFeet(feet, trained.design, limits.tare, sensitivity, noise)
        self.tares = Tares(limits.tare, feet, limits.scan_ns)
        self._n_per_rel, self._track = sensitivity.load_n_per_mean_closure, limits.track_baseline
        self._contact = partial(
            ContactDetector,
            limits.contact.least_n(trained.max_force_n),
            # A load in swing rises faster than the force errors that drift causes.
            SIGMAS * MAX_DRIFT_PF_PER_S * load_n_per_pf(trained.design, sensitivity),
            1e-9 * limits.scan_ns,
        )
        self.contacts = [self._contact() for _ in feet.names]
        self._turn = 0
        self.flags = np.zeros(len(feet.names), np.uint8)
        self.swing_variance_n2 = np.zeros((len(feet.names), 1))
        self._flags: list[int] = []
        self._swinging: list[int] = []

    def process_tares(
        self, scan: CapFrame, elements: ElementStatus, excluded: Mask, now_ns: int
    ) -> tuple[CommandResult, ...]:
        """Add a frame of all legs to the tares in progress; return the results of those that finish with it.

        Args:
            scan: The frame.
            elements: Status of its elements.
            excluded: Elements that contradict the others, shape (legs, elements).
            now_ns: Current time [ns].
        """
        tares, unloaded, contacts = self.tares, self.unloaded, self.contacts
        lost: list[int] = []
        if np.count_nonzero(scan.reading):
            lost = tares.restart_silent_legs(scan.reading, now_ns)
            for leg in lost:
                unloaded.legs[leg].discard()
                self.contacts[leg] = self._contact()
        else:
            tares.heard_ns = [now_ns] * len(contacts)
        tared_pf: dict[int, Vector] = {}
        results: tuple[CommandResult, ...] = ()
        if tares.in_progress:
            # Pressed or shorted? The other closures show it, and without a baseline there are none.
            over_range = elements.over_range & np.isnan(unloaded.baseline_pf)
            unusable = missing_sets_containing(elements.opened, excluded, over_range)
            tared_pf, results = tares.add(
                scan._replace(capacitance_pf=elements.capacitance_pf),
                unusable,
                now_ns,
                lambda leg: contacts[leg].refusal(CommandKind.TARE),
            )
            for leg, baseline_pf in tared_pf.items():
                newest_ns = int(scan.t_ns[leg].max())
                unloaded.legs[leg].set_tared(baseline_pf, newest_ns)
                self.contacts[leg].reset(newest_ns)
        if lost or tared_pf:
            unloaded.update([*lost, *tared_pf])
            unloaded.sigma_due_ns = 0
        if now_ns >= unloaded.sigma_due_ns:
            unloaded.update_sigma(now_ns)
        return results

    def observe(
        self,
        closure_rel: Vector,
        predicted_n: Vector,
        sigma_n: Vector,
        capacitance_pf: Vector,
        t_ns: Stamps,
        newest_ns: Stamps,
        missing: Mask,
        now_ns: int,
        own_acceleration: Sequence[float],
    ) -> None:
        """Detect contact, and update the baselines of legs in swing.

        Args:
            closure_rel: Measured closures over the gap [1], shape (legs, elements), NaN where there is none.
            predicted_n: Force along each leg as of now, from the last readings [N], shape (legs,), NaN for none.
            sigma_n: Its standard deviation [N], same shape.
            capacitance_pf: Readings without stray that they come from [pF], same shape.
            t_ns: Stamp of each [ns], same shape.
            newest_ns: Stamp of each leg's newest reading [ns], shape (legs,).
            missing: Elements that the network does without, shape (legs, elements).
            now_ns: Current time [ns].
            own_acceleration: Size of the acceleration by which each foot's own mass pulls [m/s2]; NaN: not known.
        """
        if np.count_nonzero(missing):
            closure_rel = np.where(missing, np.nan, closure_rel)
        means_rel = trimmed_means(closure_rel)
        swung, swinging = self._swinging, []
        flags, not_ground_n = [], []
        n_per_rel = self._n_per_rel
        refused, untared = self.tares.refused, self.tares.untared
        of_now = newest_ns.tolist(), predicted_n.tolist(), sigma_n.tolist(), own_acceleration
        of_baseline = self.unloaded.legs, self.unloaded.max_errors_n
        legs = zip(*of_baseline, self.contacts, means_rel, *of_now, strict=True)
        for leg, (baseline, error_n, contact, mean_rel, newest, as_of_now_n, sigma, own) in enumerate(legs):
            load_n = mean_rel * n_per_rel
            pull_n = load_n if load_n < -error_n else 0.0
            with_pull_n = math.hypot(sigma, pull_n) if pull_n else sigma
            contact.observe(load_n, error_n, newest, now_ns, as_of_now_n, with_pull_n, own)
            in_contact = contact.in_contact
            # What a foot in the air reads is none of the ground.
            not_ground_n.append(pull_n if in_contact or math.isnan(load_n) else load_n)
            flag = _CONTACT if in_contact else 0
            flags.append(flag | _TARE_REFUSED if leg in refused else flag)
            if leg in untared:
                continue
            if contact.in_swing:
                swinging.append(leg)
            elif leg in swung or baseline.status is not _HELD:
                baseline.pause_tracking()
        self._swinging = swinging
        self._track_drift(capacitance_pf, t_ns, missing)
        if flags != self._flags:
            self._flags, self.flags = flags, np.array(flags, np.uint8)
        self.swing_variance_n2 = np.square(np.array(not_ground_n))[:, None]

    def _track_drift(self, capacitance_pf: Vector, t_ns: Stamps, missing: Mask) -> None:
        """Update the baselines of those legs in swing whose turn it is; arguments as of `observe`."""
        self._turn = (self._turn + 1) % _FRAMES_PER_TRACKING_ROUND
        moved = []
        for leg in self._swinging:
            if leg % _FRAMES_PER_TRACKING_ROUND == self._turn:
                baseline = self.unloaded.legs[leg]
                pf, without = capacitance_pf[leg], missing[leg]
                if np.count_nonzero(without):
                    # An element that is missing only for want of a baseline gets one.
                    pf = np.where(without & np.isfinite(baseline.baseline_pf), np.nan, pf)
                held = None if self.contacts[leg].explained_by_drift else _DRIFT_TOO_FAST
                if baseline.observe_swing(pf, t_ns[leg], held if self._track else _HELD):
                    moved.append(leg)
        unloaded = self.unloaded
        if moved or list(map(_status_of, unloaded.legs)) != unloaded.drift.status.tolist():
            unloaded.update(moved)
