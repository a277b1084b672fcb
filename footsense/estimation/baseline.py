"""Contact of each leg from the level and the rate of its load, and in swing the tracking of its baseline.

The load is compared with the load in swing, not with the baseline. In swing that follows the load down once it has been
low for 50 ms, and up by at most `max_swing_rise_n_per_s`; in stance it stands still. So drift, which is slow, never
makes contact, however far it goes, and a touchdown, which is fast, is detected in the first reading that is the
threshold above the load in swing. The threshold follows from the noise and the shake of earlier swings
(`SwingNoise`), and a load within `_CONTACT_SIGMAS` of its own sigma is none: readings that contradict one another, as
where a line breaks, make a force with a sigma of its size. A load that rises more slowly than `max_swing_rise_n_per_s`
cannot be told from drift and is not detected.

Contact ends when the load is back within `lift_n` of that in swing. After a long stance that may never happen: the
baseline has drifted meanwhile, and creep of the rubber recovers over minutes. So contact also ends when the load has
fallen fast to a small part of its recent mean, as soon as drift and creep could explain what is left. A foot that
carries little without having carried more just before stays in contact indefinitely.

One element alone makes no contact: the load is a trimmed mean, without the largest and the smallest closure.
"""

import math
from functools import partial
from operator import attrgetter

import numpy as np

from footsense.estimation.drift import UnloadedFeet
from footsense.estimation.missing_elements import trimmed_means
from footsense.estimation.noise import ReadingNoise, SwingNoise
from footsense.estimation.settings import MIN_SWING_RISE_N_PER_S, EstimationLimits, MountedFeet, Sensitivity
from footsense.estimation.tare import Tares
from footsense.foot.capacitor import Capacitor
from footsense.frames import BaselineStatus, Codes, CommandKind, CommandResult, Flag, Mask, Stamps, Vector

#: A fall ends contact below this share of the mean load over the last second or so [1].
_LIFT_OFF_SHARE_OF_RECENT_MEAN = 0.3
_RECENT_LOAD_TIME_CONSTANT_S = 1.0

#: So does a fall below this share of it [1] to a load that is steady for this time, and so many thresholds at most: all
#: readings of the foot have shifted in its stance.
_SHIFTED_SHARE_OF_RECENT_MEAN, _STEADY_NS, _MAX_SHIFT_THRESHOLDS = 0.15, 50_000_000, 2.0

#: Largest creep that may remain after lift-off, over the mean load of the last minutes [1]. An assumption on the safe
#: side: Prony series of PDMS add 2 to 5 % over minutes; no foot has been measured.
_MAX_CREEP_REL = 0.05
_CREEP_LOAD_TIME_CONSTANT_S = 100.0

#: Time for which the load has to be low before that in swing follows it: a negative glitch must not make contact later.
_SWING_LOAD_FOLLOWS_AFTER_NS = 50_000_000

#: Sigmas of the force that a load has to exceed to be contact [1]: false touchdowns of walks with faults are below, of
#: healthy ones 7 % come later by one conversion; with a whole sigma 13 %, and some by two.
_CONTACT_SIGMAS = 0.8

#: A contact as short as this, that never came above so many times the thresholds, was shake.
_SHAKE_MAX_NS, _SHAKE_MAX_THRESHOLDS = 60_000_000, 2.0

#: Contact is held for this time after the last load: by then every element has been read again. Elements that are read
#: one after the other, of a load that falls or rises fast, ring.
_CONTACT_HOLD_NS = 24_000_000
#: Time after lift-off from which a swing is confirmed [s]: most of the rubber's quick recovery is over by then, and
#: half the swing of a fast gait is left.
_SWING_CONFIRMED_AFTER_S = 0.2
#: After lift-off a prediction overshoots for this time, and predicts no contact.
_PREDICTION_OVERSHOOT_NS = 100_000_000

#: Contact is kept for this time without a reading, and unknown afterwards.
_CONTACT_TIMEOUT_NS = 250_000_000

#: Frames in which every leg gets its turn to follow: two of six legs in one frame, of opposite tripods.
_FRAMES_PER_TRACKING_ROUND = 3

_status_of = attrgetter("status")
# Plain numbers: an enumeration's arithmetic costs a microsecond each time.
_CONTACT, _TARE_REFUSED = int(Flag.CONTACT), int(Flag.TARE_REFUSED)
_HELD, _DRIFT_TOO_FAST = BaselineStatus.HELD, BaselineStatus.DRIFT_TOO_FAST


class ContactDetector:
    """Contact detector of one leg; in plain Python numbers, faster than arrays for six legs.

    Args:
        least_n: Least load above that in swing that is contact [N].
        max_swing_rise_n_per_s: Fastest rise of the load in swing [N/s].

    Attributes:
        in_contact: Whether the foot is in contact; False where that is not known.
        raw: Whether the newest load alone is above the threshold.
        uncertain_n: Load that the sigma of the force does not allow to tell from none [N]; NaN without a force.
        in_swing: Whether swing is confirmed: lifted for `_SWING_CONFIRMED_AFTER_S`, and the load not about to touch.
        load_n: Load along the leg above its baseline [N], NaN where it is not known.
        drift_n: Largest load that drift and creep alone could produce now [N].
        explained_by_drift: Whether drift and creep could explain the whole load; False where the load is not known.
        swing_load_n: Load of the foot in swing [N].
        noise: Threshold of the load.
        predicted_noise: Threshold of the predicted load.
    """

    def __init__(self, least_n: float, max_swing_rise_n_per_s: float = MIN_SWING_RISE_N_PER_S) -> None:
        self._max_swing_rise_n_per_s = max_swing_rise_n_per_s
        self.noise = SwingNoise(least_n)
        self.predicted_noise = SwingNoise(least_n)
        self._explained_n = least_n / 2
        self._creep_load_n = self.drift_n = 0.0
        self.reset(0)

    def reset(self, t_ns: int) -> None:
        """Discard the history, after a new baseline or a long silence of the leg at `t_ns` [ns]."""
        self.in_contact = self.raw = self.in_swing = self.explained_by_drift = False
        self.load_n = self.uncertain_n = math.nan
        self.swing_load_n = self._recent_n = self._steady_n = 0.0
        self._peak_n = self._predicted_peak_n = 0.0
        self.noise.discard_pending(t_ns)
        self.predicted_noise.discard_pending(t_ns)
        # The highest load of the last _SWING_LOAD_FOLLOWS_AFTER_NS to twice that, in two windows.
        self._highest_before_n = self._highest_n = math.inf
        self._t_ns = self._window_start_ns = self._touched_ns = self._loaded_ns = self._lifted_ns = t_ns
        self._steady_since_ns = t_ns

    def observe(
        self,
        load_n: float,
        baseline_error_n: float,
        t_ns: int,
        now_ns: int,
        predicted_n: float = math.nan,
        sigma_n: float = math.nan,
    ) -> None:
        """Process the newest load: update contact, confirmed swing, and the load in swing.

        Args:
            load_n: Load along the leg above its baseline [N], NaN where it is not known.
            baseline_error_n: Largest error of the baseline [N].
            t_ns: Stamp of the newest reading [ns].
            now_ns: Current time [ns].
            predicted_n: The same load as predicted from the newest reading, which shows a touchdown before most
                elements have been read again [N]; NaN without a prediction.
            sigma_n: Standard deviation of the prediction [N], same.
        """
        self.load_n = load_n
        if not math.isfinite(load_n):
            self.in_swing = self.explained_by_drift = False
            if now_ns - self._t_ns > _CONTACT_TIMEOUT_NS:
                self.reset(now_ns)
            return
        elapsed_s = max(t_ns - self._t_ns, 0) * 1e-9
        self._t_ns = t_ns
        self.drift_n = baseline_error_n + _MAX_CREEP_REL * self._creep_load_n
        self.explained_by_drift = abs(load_n) <= self._explained_n + self.drift_n
        swing_load_n = self.swing_load_n
        above_n = load_n - swing_load_n
        predicted_above_n = predicted_n - swing_load_n
        noise, predicted_noise = self.noise, self.predicted_noise
        self.uncertain_n = uncertain_n = _CONTACT_SIGMAS * sigma_n
        overshoots = t_ns - self._lifted_ns <= _PREDICTION_OVERSHOOT_NS
        # Of a threshold and NaN, `max` is the threshold.
        is_predicted = predicted_above_n > max(predicted_noise.contact_n, uncertain_n) and not overshoots
        self.raw = above_n > max(noise.contact_n, uncertain_n) or is_predicted
        if self.in_contact:
            lift_n = 0.5 * noise.contact_n
            # Measured above the baseline if the load in swing is below it: a foot must be able to leave contact.
            fallen = (
                load_n < _LIFT_OFF_SHARE_OF_RECENT_MEAN * self._recent_n
                and load_n - max(swing_load_n, 0.0) < lift_n + self.drift_n
            )
            if not (above_n < lift_n or fallen or self._has_shifted(load_n, above_n, t_ns)):
                self._loaded_ns = t_ns
            elif t_ns - self._loaded_ns >= _CONTACT_HOLD_NS:
                self._end_contact(load_n, baseline_error_n, t_ns)
        elif self.raw:
            self.in_contact = True
            self._touched_ns = self._loaded_ns = self._steady_since_ns = t_ns
            self._peak_n, self._predicted_peak_n = above_n, predicted_above_n
            noise.discard_pending(t_ns)
            predicted_noise.discard_pending(t_ns)
        else:
            # What only sigma keeps from being contact is no noise of a swing.
            noise.block_n.append(above_n if above_n <= noise.contact_n else math.nan)
            if t_ns >= noise.end_ns:
                noise.end_block(t_ns)
            is_noise = predicted_above_n <= predicted_noise.contact_n and not overshoots
            predicted_noise.block_n.append(predicted_above_n if is_noise else math.nan)
            if t_ns >= predicted_noise.end_ns and not overshoots:
                predicted_noise.end_block(t_ns)
            if t_ns - self._window_start_ns > _SWING_LOAD_FOLLOWS_AFTER_NS:
                self._highest_before_n = self._highest_n
                self._highest_n, self._window_start_ns = load_n, t_ns
            self._highest_n = max(self._highest_n, load_n)
            highest_n = max(self._highest_n, self._highest_before_n)
            self.swing_load_n = min(highest_n, swing_load_n + self._max_swing_rise_n_per_s * elapsed_s)
        self.in_swing = (
            not self.in_contact
            and load_n - self.swing_load_n < 0.5 * self._explained_n
            and (t_ns - self._lifted_ns) * 1e-9 >= _SWING_CONFIRMED_AFTER_S
        )
        pressing_n = max(load_n, 0.0)
        self._recent_n += (pressing_n - self._recent_n) * (
            elapsed_s / (_RECENT_LOAD_TIME_CONSTANT_S + elapsed_s)
        )
        self._creep_load_n += (pressing_n - self._creep_load_n) * (
            elapsed_s / (_CREEP_LOAD_TIME_CONSTANT_S + elapsed_s)
        )

    def _has_shifted(self, load_n: float, above_n: float, t_ns: int) -> bool:
        """Return whether a load in contact is a shift of all readings, and the foot is in the air."""
        if abs(load_n - self._steady_n) > 0.5 * self.noise.contact_n:
            self._steady_n, self._steady_since_ns = load_n, t_ns
        return (
            t_ns - self._steady_since_ns >= _STEADY_NS
            and load_n < _SHIFTED_SHARE_OF_RECENT_MEAN * self._recent_n
            and above_n < _MAX_SHIFT_THRESHOLDS * self.noise.contact_n
        )

    def _end_contact(self, load_n: float, baseline_error_n: float, t_ns: int) -> None:
        """End the contact; a contact short and light enough to be shake raises the threshold."""
        self.in_contact = False
        if t_ns - self._touched_ns < _SHAKE_MAX_NS:
            peaks = (self.noise, self._peak_n), (self.predicted_noise, self._predicted_peak_n)
            if all(peak_n < _SHAKE_MAX_THRESHOLDS * noise.contact_n for noise, peak_n in peaks):
                for noise, peak_n in peaks:
                    noise.add_peak(peak_n)
        self._lifted_ns = self._window_start_ns = t_ns
        self.noise.discard_pending(t_ns)
        self.predicted_noise.discard_pending(t_ns)
        # A foot can be pressed, not pulled: a load in swing below the baseline's error would turn the next reading
        # into a touchdown.
        self.swing_load_n = max(load_n, -baseline_error_n)
        self._highest_before_n = self._highest_n = self.swing_load_n

    def refusal(self, kind: CommandKind) -> str | None:
        """Return why a command is refused at present (foot in contact); None if it may be executed.

        A controller that leans on a leg must not lose its force by one frame, so a leg in contact is not stopped. Nor
        is it tared, unless drift and creep could explain its load: then the tare itself decides, since a foot that was
        lifted as slowly as drift is still in contact here. Where contact is not known, as without a baseline, there is
        no force to lose: the leg may be stopped, and a tare is decided by its readings. START is always safe.
        """
        is_tare = kind is CommandKind.TARE
        if not self.in_contact or kind is CommandKind.START or (is_tare and self.load_n <= self.drift_n):
            return None
        unknown = math.isnan(self.load_n)
        carries = "its load is not known now" if unknown else f"it carries {self.load_n:.2f} N"
        limit = f", and drift explains at most {self.drift_n:.2f} N" if is_tare else ""
        return f"the foot is in contact: {carries}{limit}"


class BaselineTracker:
    """Baselines and contact detectors of all legs, and the tares in progress.

    Every leg is tared at start, repeatedly until that succeeds.

    Args:
        feet: The feet.
        design: The capacitors.
        limits: Limits of tare and contact, and whether baselines follow a foot in swing.
        sensitivity: Forces per closure.
        noise: Noise of each leg's readings.

    Attributes:
        contacts: Contact of each leg.
        tares: Tares in progress.
        unloaded: The baselines, and what follows from them.
        flags: CONTACT, and TARE_REFUSED where an older baseline is in use, shape (legs,).
    """

    def __init__(
        self,
        feet: MountedFeet,
        design: Capacitor,
        limits: EstimationLimits,
        sensitivity: Sensitivity,
        noise: ReadingNoise,
    ) -> None:
        self.unloaded = UnloadedFeet(feet, design, limits.tare, sensitivity, noise)
        self.tares = Tares(limits.tare, feet, limits.scan_ns)
        self._n_per_rel, self._track = sensitivity.load_n_per_mean_closure, limits.track_baseline
        self._contact = partial(ContactDetector, limits.least_contact_n, limits.max_swing_rise_n_per_s)
        self.contacts = [self._contact() for _ in feet.names]
        self._turn = 0
        self.flags = np.zeros(len(feet.names), np.uint8)
        self._flags: list[int] = []
        self._swinging: list[int] = []

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
        tares, unloaded, contacts = self.tares, self.unloaded, self.contacts
        lost: list[int] = []
        if np.count_nonzero(reading):
            lost = tares.restart_silent_legs(reading, now_ns)
            for leg in lost:
                unloaded.legs[leg].discard()
                self.contacts[leg] = self._contact()
        else:
            tares.heard_ns.fill(now_ns)
        tared_pf: dict[int, Vector] = {}
        results: tuple[CommandResult, ...] = ()
        if tares.in_progress:
            tared_pf, results = tares.add(
                capacitance_pf,
                reading,
                t_ns,
                unusable,
                now_ns,
                lambda leg: contacts[leg].refusal(CommandKind.TARE),
            )
            for leg, baseline_pf in tared_pf.items():
                newest_ns = int(t_ns[leg].max())
                unloaded.legs[leg].set_tared(baseline_pf, newest_ns)
                self.contacts[leg].reset(newest_ns)
        if lost or tared_pf:
            unloaded.update()
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
        missing: Mask,
        now_ns: int,
    ) -> None:
        """Detect contact, and update the baselines of legs in swing.

        Args:
            closure_rel: Measured closures over the gap [1], shape (legs, elements), NaN where there is none.
            predicted_n: Force along each leg as of now, from the last readings [N], shape (legs,), NaN for none.
            sigma_n: Its standard deviation [N], same shape.
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
        n_per_rel = self._n_per_rel
        refused, untared = self.tares.refused, self.tares.untared
        legs = zip(
            self.unloaded.legs,
            self.contacts,
            means_rel,
            self.unloaded.max_errors_n,
            newest_ns,
            predicted_n.tolist(),
            sigma_n.tolist(),
            strict=True,
        )
        for leg, (baseline, contact, mean_rel, error_n, newest, *predicted) in enumerate(legs):
            contact.observe(mean_rel * n_per_rel, error_n, newest, now_ns, *predicted)
            in_contact = contact.in_contact
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

    def _track_drift(self, capacitance_pf: Vector, t_ns: Stamps, missing: Mask) -> None:
        """Update the baselines of those legs in swing whose turn it is; arguments as of `observe`."""
        self._turn = (self._turn + 1) % _FRAMES_PER_TRACKING_ROUND
        moved = False
        for leg in self._swinging:
            if leg % _FRAMES_PER_TRACKING_ROUND == self._turn:
                baseline = self.unloaded.legs[leg]
                # An element that is missing only for want of a baseline gets one.
                ignored = missing[leg] & np.isfinite(baseline.baseline_pf)
                pf = np.where(ignored, np.nan, capacitance_pf[leg])
                held = None if self.contacts[leg].explained_by_drift else _DRIFT_TOO_FAST
                moved |= baseline.observe_swing(pf, t_ns[leg], held if self._track else _HELD)
        unloaded = self.unloaded
        if moved or list(map(_status_of, unloaded.legs)) != unloaded.drift.status.tolist():
            unloaded.update()
