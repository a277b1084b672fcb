"""Contact of each leg from the level and the rate of its load, and in swing the tracking of its baseline.

The load is compared with the load in swing, not with the baseline. In swing that follows the load down once it has been
low for 50 ms, and up by at most `max_swing_rise_n_per_s`; in stance it stands still. So drift, which is slow, never
makes contact, however far it goes, and a touchdown, which is fast, is detected in the first reading that is the
threshold above the load in swing. In swing the foot's own mass pulls at the sensor, on a light robot as much as light
loads do: the threshold is a share of the heaviest load of the last seconds, and less where the noise of earlier swings
allows it (`SwingNoise`). Shake that makes a contact all the same is learnt when that ends, short and light. A load
within its own sigma is none: readings that contradict one another, as where a line breaks, make a force with a sigma of
its size. A load that rises more slowly than `max_swing_rise_n_per_s` cannot be told from drift and is not detected.

Contact ends when the load is back to a small part of that of the stance. After a long stance that may never happen: the
baseline has drifted meanwhile, and creep of the rubber recovers over minutes. So contact also ends when the load has
fallen fast to a small part of its recent mean, as soon as drift and creep could explain what is left. A foot that
carries little without having carried more just before stays in contact indefinitely.

One element alone makes no contact: the load is a trimmed mean, without the largest and the smallest closure.
"""

import math

from footsense.estimation.noise import SwingNoise
from footsense.estimation.settings import LONG_SILENCE_NS
from footsense.frames import CommandKind

#: A fall ends contact below this share of the mean load over the last second or so [1].
_LIFT_OFF_SHARE_OF_RECENT_MEAN = 0.3
_RECENT_LOAD_TIME_CONSTANT_S = 1.0

#: So does a fall below this share of it [1] to a load that is steady, and so many thresholds at most: all readings of
#: the foot have shifted in its stance.
_SHIFTED_SHARE_OF_RECENT_MEAN = _LIFT_OFF_SHARE_OF_RECENT_MEAN / 2.0
_MAX_SHIFT_THRESHOLDS = 2.0

#: Largest creep that may remain after lift-off, over the mean load of the last minutes [1]. An assumption on the safe
#: side: Prony series of PDMS add 2 to 5 % over minutes; no foot has been measured.
_MAX_CREEP_REL = 0.05
_CREEP_LOAD_TIME_CONSTANT_S = 100.0

#: Time for which a load has to be steady [ns]: low, before that in swing follows it, as a negative glitch must not make
#: contact later, and in contact, before it is a shift.
_STEADY_NS = 50_000_000

#: Share of the heaviest load that is contact, whatever the swing shows, and below which a contact is light [1], and
#: time in which that load is forgotten [s]. Chosen on the walkers' selection: with the noise of swings alone every
#: third touch of a light robot was missed, since its shake had made contact before.
_HEAVY_REL, _HEAVY_MEMORY_S = 0.25, 10.0
#: Load that ends contact over that which begins it, and over the recent mean [1].
_LIFT_OFF_REL, _LIFT_OFF_SHARE = 0.7, 0.2

#: A contact as short as this is shake if it is light. One below so many least thresholds is light, where a foot has not
#: carried yet, and none above so many: no foot's own mass pulled so much in the walkers' gaits.
_SHAKE_MAX_NS, _LIGHT_THRESHOLDS = 3 * _STEADY_NS, (2.0, 4.0)

#: Contact is held for this time after the last load, and for the other after a touchdown: elements that are read one
#: after the other, of a load that falls or rises fast, ring, and not all show a touch that a prediction tells.
_CONTACT_HOLD_NS = 14_000_000
_TOUCHDOWN_HOLD_NS = 2 * _CONTACT_HOLD_NS
#: Time in which a foot rings [ns]: after a touchdown that is not light it bounces, and contact is held as after a
#: touchdown; after lift-off a prediction overshoots, and predicts no contact. Twice that after lift-off a swing is
#: confirmed: most of the rubber's quick recovery is over by then, and half the swing of a fast gait is left.
_RINGS_NS = 2 * _STEADY_NS


class ContactDetector:
    """Contact detector of one leg; in plain Python numbers, faster than arrays for six legs.

    Args:
        least_n: Least load above that in swing that is contact [N].
        max_swing_rise_n_per_s: Fastest rise of the load in swing [N/s].
        prediction_sigmas: Sigmas within which a predicted load is none [1].

    Attributes:
        in_contact: Whether the foot is in contact; False where that is not known.
        raw: Whether the newest load alone is above the threshold.
        touch_n: Load above that in swing that is contact [N].
        predicted_touch_n: The same of the predicted load [N].
        in_swing: Whether swing is confirmed: lifted for two `_RINGS_NS`, and the load not about to touch.
        load_n: Load along the leg above its baseline [N], NaN where it is not known.
        carried_n: The same of the force as of now, or that where there is no force [N].
        drift_n: Largest load that drift and creep alone could produce now [N].
        explained_by_drift: Whether drift and creep could explain the whole load; False where the load is not known.
        swing_load_n: Load of the foot in swing [N].
        noise: Noise of the load in swing.
        predicted_noise: Noise of the predicted load.
    """

    def __init__(
        self,
        least_n: float,
        max_swing_rise_n_per_s: float,
        prediction_sigmas: float = 1.0,
    ) -> None:
        self._max_swing_rise_n_per_s = max_swing_rise_n_per_s
        self.noise = SwingNoise(least_n)
        self.predicted_noise = SwingNoise(least_n)
        self._prediction_sigmas = prediction_sigmas
        self._least_n = self.touch_n = self.predicted_touch_n = least_n
        self._explained_n = least_n / 2
        self._creep_load_n = self._heavy_n = self.drift_n = 0.0
        self.reset(0)

    def reset(self, t_ns: int) -> None:
        """Discard the history, after a new baseline or a long silence of the leg at `t_ns` [ns]."""
        self.in_contact = self.raw = self.in_swing = self.explained_by_drift = False
        self.load_n = self.carried_n = math.nan
        self.swing_load_n = self._recent_n = self._steady_n = 0.0
        self._peak_n = self._predicted_peak_n = 0.0
        self.noise.discard_pending(t_ns)
        self.predicted_noise.discard_pending(t_ns)
        # The highest load of the last _STEADY_NS to twice that, in two windows.
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
        self.carried_n = predicted_n if math.isfinite(predicted_n) else load_n
        if not math.isfinite(load_n):
            self.in_swing = self.explained_by_drift = False
            if now_ns - self._t_ns > LONG_SILENCE_NS:
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
        overshoots = t_ns - self._lifted_ns <= _RINGS_NS
        heavy_n = self._heavy_n * max(1.0 - elapsed_s / _HEAVY_MEMORY_S, 0.0)
        self._heavy_n = max(heavy_n, load_n if self.in_contact else 0.0)
        shake_n = _HEAVY_REL * self._heavy_n
        noise_n = max(self._least_n, min(shake_n, noise.contact_n))
        predicted_noise_n = max(self._least_n, min(shake_n, predicted_noise.contact_n))
        # Of a number and NaN, in this order, `max` is the number.
        self.touch_n = max(noise_n, sigma_n)
        self.predicted_touch_n = max(predicted_noise_n, self._prediction_sigmas * sigma_n)
        is_predicted = predicted_above_n > self.predicted_touch_n and not overshoots
        self.raw = above_n > self.touch_n or is_predicted
        if self.in_contact:
            lift_n = max(self._explained_n, min(_LIFT_OFF_REL * noise_n, _LIFT_OFF_SHARE * self._recent_n))
            # Measured above the baseline if the load in swing is below it: a foot must be able to leave contact.
            fallen = (
                load_n < _LIFT_OFF_SHARE_OF_RECENT_MEAN * self._recent_n
                and load_n - max(swing_load_n, 0.0) < lift_n + self.drift_n
            )
            self._peak_n = max(self._peak_n, above_n)
            self._predicted_peak_n = max(self._predicted_peak_n, predicted_above_n)
            if abs(load_n - self._steady_n) > self._explained_n:
                self._steady_n, self._steady_since_ns = load_n, t_ns
            is_steady = t_ns - self._steady_since_ns >= _STEADY_NS
            if not (above_n < lift_n or fallen or (is_steady and self._is_a_shift(load_n, above_n))):
                self._loaded_ns = t_ns
            elif t_ns - self._touched_ns >= _TOUCHDOWN_HOLD_NS and t_ns - self._loaded_ns >= self._hold_ns(
                t_ns
            ):
                self._end_contact(load_n, baseline_error_n, t_ns)
        elif self.raw:
            self.in_contact = True
            self._touched_ns = self._loaded_ns = self._steady_since_ns = t_ns
            self._peak_n, self._predicted_peak_n = above_n, max(0.0, predicted_above_n)
            noise.discard_pending(t_ns)
            predicted_noise.discard_pending(t_ns)
        else:
            self._observe_swing(
                load_n, noise_n, math.nan if overshoots else predicted_n, predicted_noise_n, elapsed_s
            )
        self.in_swing = (
            not self.in_contact
            and load_n - self.swing_load_n < 0.5 * self._explained_n
            and t_ns - self._lifted_ns >= 2 * _RINGS_NS
        )
        pressing_n = max(load_n, 0.0)
        self._recent_n += (pressing_n - self._recent_n) * (
            elapsed_s / (_RECENT_LOAD_TIME_CONSTANT_S + elapsed_s)
        )
        self._creep_load_n += (pressing_n - self._creep_load_n) * (
            elapsed_s / (_CREEP_LOAD_TIME_CONSTANT_S + elapsed_s)
        )

    @property
    def _is_light(self) -> bool:
        """Whether the load of this contact could be of the foot's own mass: it never came to much."""
        limit_n = max(_HEAVY_REL * self._heavy_n, _LIGHT_THRESHOLDS[0] * self._least_n)
        return self._peak_n < min(limit_n, _LIGHT_THRESHOLDS[1] * self._least_n)

    def _hold_ns(self, t_ns: int) -> int:
        bounces = t_ns - self._touched_ns < _RINGS_NS and not self._is_light
        return _TOUCHDOWN_HOLD_NS if bounces else _CONTACT_HOLD_NS

    def _is_a_shift(self, load_n: float, above_n: float) -> bool:
        """Return whether a steady load in contact is a shift of all readings, and the foot is in the air."""
        return (
            load_n < _SHIFTED_SHARE_OF_RECENT_MEAN * self._recent_n
            and above_n < _MAX_SHIFT_THRESHOLDS * self.touch_n
        )

    def _observe_swing(
        self, load_n: float, noise_n: float, predicted_n: float, predicted_noise_n: float, elapsed_s: float
    ) -> None:
        """Learn the noise of a swing, and follow its load."""
        t_ns, swing_load_n = self._t_ns, self.swing_load_n
        for noise, signal_n, touch_n in (
            (self.noise, load_n, noise_n),
            (self.predicted_noise, predicted_n, predicted_noise_n),
        ):
            # What only sigma keeps from being contact is no noise.
            if signal_n - swing_load_n <= touch_n:
                noise.block_n.append(signal_n - swing_load_n)
            if t_ns >= noise.end_ns:
                noise.end_block(t_ns, touch_n)
        if t_ns - self._window_start_ns > _STEADY_NS:
            self._highest_before_n = self._highest_n
            self._highest_n, self._window_start_ns = load_n, t_ns
        self._highest_n = max(self._highest_n, load_n)
        highest_n = max(self._highest_n, self._highest_before_n)
        self.swing_load_n = min(highest_n, swing_load_n + self._max_swing_rise_n_per_s * elapsed_s)

    def _end_contact(self, load_n: float, baseline_error_n: float, t_ns: int) -> None:
        """End the contact; a contact short and light enough to be shake raises the threshold above its peak."""
        self.in_contact = False
        if t_ns - self._touched_ns < _SHAKE_MAX_NS and self._is_light:
            self.noise.add_peak(self._peak_n)
            self.predicted_noise.add_peak(self._predicted_peak_n)
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
        carries = (
            "its load is not known now" if unknown else f"it carries {max(self.carried_n, self.load_n):.2f} N"
        )
        limit = f", and drift explains at most {self.drift_n:.2f} N" if is_tare else ""
        return f"the foot is in contact: {carries}{limit}"
