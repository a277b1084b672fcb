"""Contact of each leg: the probability that the foot is on the ground, from the level of its load.

A hidden Markov model of two states, swing and stance (Rabiner, Proceedings of the IEEE 77, 1989). What is observed is
the load z above that in swing: the trimmed mean of a scan, so that one element alone makes no contact, brought to the
newest reading by its slope.

- In swing it is normal about zero with the spread S: of noise, of the pull of the foot's own mass, as far as earlier
  swings have shown it, and after a stance of the baseline's error and of what is left of creep.
- In stance it is exponential with a mean well above that of the last stances, with the same noise: loads of all sizes
  are expected, since a foot that begins to carry carries little.

With the foot's acceleration known, the load in swing that it explains is subtracted first: the mean of the
acceleration's size over a scan, times what earlier swings have shown per unit of it, and the spread is of what is left.
So a wrong or late acceleration explains little, and does little.

Readings closer together than the time over which pull and bounces last count as one. Contact begins and ends at two
probabilities. Outside of contact the load that the network predicts from the newest reading counts as well, with its
sigma: it shows a touch before most elements have been read again.

The load in swing follows the load down within a fraction of a second and up by at most `max_swing_rise_n_per_s`; in
stance it stands still. So drift, which is slow, never makes contact, however far it goes. A load that rises more slowly
than that is taken for drift. A load that stays low and steady in a stance, small against what the foot carries,
counts against contact: all readings have shifted meanwhile.

A touchdown is dated by the last time at which the load came above S, less the time of its rise and a part of a scan;
where it had come above S shortly before as well, the foot may have touched then, which sigma says. A lift-off is dated
by the last time at which the load fell below S.
"""

import math
import sys
from collections import deque
from typing import NamedTuple

from footsense.estimation.drift import DRIFT_TIME_CONSTANT_S
from footsense.estimation.settings import (
    CORRELATED_S,
    LONG_SILENCE_NS,
    MEMORY_S,
    SIGMAS,
    SLOW_PERIOD_NS,
    SMALL_SHARE,
)
from footsense.frames import CommandKind

#: Touchdowns and lift-offs a second that are expected [1/s], and shortest usual stance [s]: a lift-off before that is
#: as much less likely as the fourth power of the time.
_EVENT_RATE, _SHORTEST_STANCE_S = 2.0, 1e-9 * SLOW_PERIOD_NS
#: Probabilities of contact at which it begins, and ends.
_BEGINS, _ENDS = 0.9, 0.01
#: Pull of a foot's own mass over the mean load of its stances, before a swing has shown it; load of a stance that may
#: be a shift of all readings, over the same [1].
_PULL_REL = 0.2
#: Time of swing as which that counts, and time in which the load in swing follows the load down [s].
_SETTLES_S = 3.0 * _SHORTEST_STANCE_S
#: Mean load that is expected of a stance, over that of the last ones [1].
_STANCE_LOAD_REL = 3.0
#: Largest creep that may remain after lift-off, over the mean load of the last minutes [1]. An assumption on the safe
#: side: Prony series of PDMS add 2 to 5 % over minutes; no foot has been measured.
_MAX_CREEP_REL = 0.05
#: Time after lift-off in which a prediction overshoots [s]; twice that after lift-off a swing is confirmed: most of the
#: rubber's quick recovery is over by then, and half the swing of a fast gait is left.
_RINGS_S = _SHORTEST_STANCE_S
#: Time in which the load of a touch rises above the spread, and its standard deviation [s]; that of a lift-off falls as
#: fast.
_RISE_S = 3e-3
_LOG_ODDS_BEGIN, _LOG_ODDS_END = math.log(_BEGINS / (1.0 - _BEGINS)), math.log(_ENDS / (1.0 - _ENDS))
#: Log odds that are kept: those of a probability that a double tells from one.
_MOST_LOG_ODDS = -math.log(sys.float_info.epsilon)
#: Log odds of a swing that has no doubt.
_SURE_SWING = -3.0
_HALF_LOG_2_PI = 0.5 * math.log(2.0 * math.pi)
_LONG_SILENCE_S = 1e-9 * LONG_SILENCE_NS
#: Time after which what changes slowly is derived again [s].
_UPDATE_S = 3.0 * CORRELATED_S
#: Factor of the logistic function that has the slope of a normal distribution's integral.
LOGISTIC = 2.0 * math.sqrt(2.0 / math.pi)


class BackDated(NamedTuple):
    """Back-dated time of an event [ns], and its standard deviation [s]."""

    t_ns: int
    sigma_s: float


NO_TIME = BackDated(0, math.nan)


def log_likelihood_ratio(z_n: float, spread_n: float, mean_n: float) -> float:
    """Return the log likelihood ratio of stance over swing of a load above that in swing.

    Args:
        z_n: The load [N].
        spread_n: Standard deviation of a load in swing [N].
        mean_n: Mean of the exponential distribution of a load in stance [N]; twice the spread at least is taken.
    """
    least_n, over = 2.0 * spread_n, z_n / spread_n
    mean_n = least_n if least_n > mean_n else mean_n
    share = spread_n / mean_n
    # Of the normal distribution's integral; below nothing it falls linearly, and the square is left out.
    below = LOGISTIC * (share - over)
    integral = (0.0 if below < 0.0 else below) + math.log1p(math.exp(-abs(below)))
    of_swing = 0.5 * over * over if over > 0.0 else 0.0
    return math.log(share) + _HALF_LOG_2_PI - z_n / mean_n + 0.5 * share * share - integral + of_swing


class _SwingLoads:
    """Loads of swings in the remembered time: how long it is, sums of squares, and the spreads that follow."""

    def __init__(self) -> None:
        self.time_s = self._load_n2s = 0.0
        self.spread_n2 = self.most_n = 0.0

    def add(self, time_s: float, load_n: float, most_n: float) -> None:
        """Add a load, as `most_n` at most [N]."""
        most_n = self.most_n if self.most_n < most_n else most_n
        self.time_s += time_s
        self._load_n2s += time_s * (most_n if most_n < load_n else load_n) ** 2

    def forget(self, kept: float) -> None:
        """Keep a share of what is remembered [1]."""
        self.time_s *= kept
        self._load_n2s *= kept

    def update(self, expected_n2: float, quiet_n2: float) -> None:
        """Derive the spreads: the geometric mean of what is expected and what was seen, by how long it was."""
        share = _SETTLES_S / (_SETTLES_S + self.time_s)
        time_s, expected = self.time_s or 1.0, expected_n2**share
        self.spread_n2 = spread_n2 = quiet_n2 + expected * max(self._load_n2s / time_s, quiet_n2) ** (
            1.0 - share
        )
        self.most_n = SIGMAS * math.sqrt(spread_n2)


class ContactDetector:
    """Contact detector of one leg; in plain Python numbers, faster than arrays for six legs.

    Args:
        least_n: Least load above that in swing that is contact [N].
        max_swing_rise_n_per_s: Fastest rise of the load in swing [N/s].
        scan_s: Time of a scan [s].

    Attributes:
        in_contact: Whether the foot is in contact; False where that is not known.
        raw: Whether the newest load alone is more likely one of contact.
        in_swing: Whether swing is confirmed: lifted for two `_RINGS_S`, and without doubt.
        load_n: Load along the leg above its baseline [N], NaN where it is not known.
        carried_n: The same of the force as of now, or that where there is no force [N].
        drift_n: Largest load that drift and creep alone could produce now [N].
        explained_by_drift: Whether drift and creep could explain the whole load; False where the load is not known.
        swing_load_n: Load of the foot in swing [N].
        changed: When the present contact or swing began.
    """

    def __init__(self, least_n: float, max_swing_rise_n_per_s: float, scan_s: float) -> None:
        self._least_n, self._scan_s = least_n, scan_s
        self._max_swing_rise_n_per_s = max_swing_rise_n_per_s
        self._creep_load_n = self.drift_n = 0.0
        # Sums over the remembered time: of loads in stance, in swing, in swing beyond what an acceleration explains,
        # and of acceleration, load, their product and squared acceleration in the latter.
        self._stance_ns = self._stance_s = 0.0
        self._pulls, self._unexplained = _SwingLoads(), _SwingLoads()
        self._moments = [0.0, 0.0, 0.0, 0.0]
        self.reset(0)

    def reset(self, t_ns: int) -> None:
        """Discard the history, after a new baseline or a long silence of the leg at `t_ns` [ns]."""
        self.in_contact = self.raw = self.in_swing = self.explained_by_drift = False
        self.load_n = self.carried_n = math.nan
        self.swing_load_n = 0.0
        self._is_above = self._is_steady = False
        self._steady_n, self._steady_s = 0.0, 1e-9 * t_ns
        self._log_odds = _SURE_SWING
        self.changed = NO_TIME
        self._t_s = self._changed_s = self._down_s = self._updated_s = 1e-9 * t_ns
        # When the load came above the spread, the last time and the time before.
        self._up_s = self._up_before_s = self._t_s
        # Loads of the last scan.
        self._past: deque[tuple[float, float]] = deque()
        # Known accelerations of the last scan.
        self._accelerations: deque[tuple[float, float]] = deque()
        self._acceleration = self._explained_n = 0.0
        self._update_spreads(self._t_s, 0.0)

    @property
    def probability(self) -> float:
        """Probability of contact [1]; NaN where the load is not known."""
        return math.nan if math.isnan(self.load_n) else 1.0 / (1.0 + math.exp(-self._log_odds))

    def observe(
        self,
        load_n: float,
        baseline_error_n: float,
        t_ns: int,
        now_ns: int,
        predicted_n: float = math.nan,
        sigma_n: float = math.nan,
        acceleration_m_per_s2: float = math.nan,
    ) -> None:
        """Process the newest load: update contact, confirmed swing, and the load in swing.

        Args:
            load_n: Load along the leg above its baseline [N], NaN where it is not known.
            baseline_error_n: Largest error of the baseline [N].
            t_ns: Stamp of the newest reading [ns].
            now_ns: Current time [ns].
            predicted_n: The same load as predicted from the newest reading [N]; NaN without a prediction.
            sigma_n: Standard deviation of the prediction [N], same.
            acceleration_m_per_s2: Size of the acceleration by which the foot's own mass pulls along the leg [m/s2]; NaN
                where it is not known.
        """
        self.load_n = load_n
        self.carried_n = predicted_n if math.isfinite(predicted_n) else load_n
        t_s, before_s = 1e-9 * t_ns, self._t_s
        if not math.isfinite(load_n):
            self.in_swing = self.explained_by_drift = False
            if now_ns - round(1e9 * before_s) > LONG_SILENCE_NS:
                self.reset(now_ns)
            return
        elapsed_s = t_s - before_s if t_s > before_s else 0.0
        elapsed_s = _LONG_SILENCE_S if elapsed_s > _LONG_SILENCE_S else elapsed_s
        self._t_s = t_s
        if t_s - self._updated_s >= _UPDATE_S:
            self._update_spreads(t_s, baseline_error_n)
        # A load stands still where it has stayed within half a least load for as long as a foot rings.
        if abs(load_n - self._steady_n) > 0.5 * self._least_n:
            self._steady_n, self._steady_s = load_n, t_s
        self._is_steady = t_s - self._steady_s > _RINGS_S
        if self._accelerations or math.isfinite(acceleration_m_per_s2):
            self._note_acceleration(t_s, acceleration_m_per_s2)
        change_n, lasted_s = self._change_over_a_scan(t_s, load_n)
        scan_s = self._scan_s
        as_of_newest_n = load_n + 0.5 * change_n * (scan_s / lasted_s if lasted_s > scan_s else 1.0)
        above_n = as_of_newest_n - self.swing_load_n
        in_contact = self.in_contact
        ratio = self._log_likelihood_ratio(above_n, predicted_n - self.swing_load_n, sigma_n)
        self.raw = ratio > 0.0
        self._update_log_odds(ratio, t_s, elapsed_s)
        self._note_crossings(above_n, t_s)
        if in_contact:
            self._stance_ns += elapsed_s * as_of_newest_n if as_of_newest_n > 0.0 else 0.0
            self._stance_s += elapsed_s
            if self._log_odds < _LOG_ODDS_END:
                self._end_contact(t_s, as_of_newest_n, baseline_error_n)
        elif self._log_odds > _LOG_ODDS_BEGIN:
            self._begin_contact(t_s, baseline_error_n)
        else:
            self._learn_swing(above_n, elapsed_s)
        if self.in_contact is not in_contact:
            self._update_spreads(t_s, baseline_error_n)
        self.in_swing = (
            not self.in_contact and self._log_odds < _SURE_SWING and t_s - self._changed_s >= 2.0 * _RINGS_S
        )
        self.explained_by_drift = abs(load_n) <= 0.5 * self._least_n + self.drift_n

    def _log_likelihood_ratio(self, above_n: float, predicted_above_n: float, sigma_n: float) -> float:
        """Return the log likelihood ratio of stance over swing of a load and its prediction, above that in swing."""
        spread_n, stance_load_n = self._spread_n, self._stance_load_n
        if self.in_contact:
            ratio = log_likelihood_ratio(above_n, spread_n, stance_load_n)
            return min(ratio, -2.0) if self._is_steady and above_n < self._shift_n else ratio
        above_n -= self._explained_n
        predicted_above_n -= self._explained_n
        # Not of NaN.
        widest_n = sigma_n if sigma_n > spread_n else spread_n
        ratio = log_likelihood_ratio(above_n, widest_n, stance_load_n)
        if self._t_s - self._changed_s > _RINGS_S and predicted_above_n > self._least_n:
            spread_n = math.hypot(spread_n, 0.5 * sigma_n)
            ratio = max(ratio, log_likelihood_ratio(predicted_above_n, spread_n, stance_load_n))
        return ratio

    def _note_acceleration(self, t_s: float, acceleration_m_per_s2: float) -> None:
        """Note the newest acceleration, its mean over a scan, and the load that this explains in swing."""
        known = self._accelerations
        if math.isfinite(acceleration_m_per_s2):
            known.append((t_s, acceleration_m_per_s2))
        while known and known[0][0] < t_s - self._scan_s:
            known.popleft()
        self._acceleration = sum(one for _, one in known) / len(known) if known else 0.0
        # By the slope of the load over the acceleration, so that one that stands still explains nothing; and next to
        # nothing as long as swings have shown little.
        time_s, (mean_s, load_s, both_s, square_s) = self._unexplained.time_s or 1.0, self._moments
        slope_kg = (both_s - mean_s * load_s / time_s) / (square_s - mean_s**2 / time_s + _SETTLES_S)
        self._explained_n = 0.5 * max(slope_kg, 0.0) * self._acceleration

    def _change_over_a_scan(self, t_s: float, load_n: float) -> tuple[float, float]:
        """Return by how much the load has changed over the last scan [N], and how long that was [s]."""
        past = self._past
        past.append((t_s, load_n))
        while len(past) > 2 and past[1][0] <= t_s - self._scan_s:
            past.popleft()
        then_s, then_n = past[0]
        # A foot that was pulled and comes back does not press.
        least_n = load_n if load_n < self.swing_load_n else self.swing_load_n
        return load_n - (least_n if least_n > then_n else then_n), t_s - then_s

    def _update_log_odds(self, ratio: float, t_s: float, elapsed_s: float) -> None:
        begins = ends = _EVENT_RATE * elapsed_s
        if self.in_contact:
            age = (t_s - self._changed_s) / _SHORTEST_STANCE_S
            if age < 1.0:
                ends *= (age * age) ** 2
        odds = math.exp(self._log_odds)
        predicted = math.log((odds * (1.0 - ends) + begins) / (1.0 - begins + odds * ends))
        updated = predicted + (elapsed_s / CORRELATED_S if elapsed_s < CORRELATED_S else 1.0) * ratio
        if not -_MOST_LOG_ODDS <= updated <= _MOST_LOG_ODDS:
            updated = _MOST_LOG_ODDS if updated > 0.0 else -_MOST_LOG_ODDS
        self._log_odds = updated

    def _note_crossings(self, above_n: float, t_s: float) -> None:
        """Note when the load came above the spread of swing, and when it fell below it."""
        is_above = above_n >= self._spread_n + self._explained_n
        if is_above is not self._is_above:
            self._is_above = is_above
            if is_above:
                self._up_before_s, self._up_s = self._up_s, t_s
            else:
                self._down_s = t_s

    def _begin_contact(self, t_s: float, baseline_error_n: float) -> None:
        # Where a prediction made the contact, and the mean does not show it yet, it is now.
        up_s = self._up_s if self._is_above else t_s
        told_later_s = max(t_s - up_s - 2.0 * self._scan_s, 0.0)
        touched_before = self._up_before_s > max(self._changed_s + _RINGS_S, t_s - _RINGS_S)
        self.in_contact = True
        self.changed = BackDated(
            round(1e9 * (up_s - _RISE_S - self._scan_s / 3.0)),
            math.hypot(
                _RISE_S,
                self._scan_s / 3.0,
                told_later_s,
                0.5 * (up_s - self._up_before_s) if touched_before else 0.0,
            ),
        )
        self._changed_s = t_s
        # A foot can be pressed, not pulled: a contact ends above the baseline, and nothing touches below it.
        self.swing_load_n = max(self.swing_load_n, -baseline_error_n)

    def _end_contact(self, t_s: float, as_of_newest_n: float, baseline_error_n: float) -> None:
        self.in_contact = False
        ended_s = self._down_s if self._down_s > self._changed_s else t_s - self._scan_s
        self.changed = BackDated(round(1e9 * (ended_s + _RISE_S)), CORRELATED_S)
        self._changed_s = t_s
        self.swing_load_n = max(as_of_newest_n, -baseline_error_n)

    def _learn_swing(self, above_n: float, elapsed_s: float) -> None:
        """Learn the spread of a swing's load, and follow it, as far as it is one."""
        swing_s = elapsed_s / (1.0 + math.exp(self._log_odds))
        # Pull comes and goes; a load that hardly changes is not pull.
        most_n = SMALL_SHARE * self._least_n if self._is_steady else math.inf
        load_n, explained_n = abs(above_n), self._explained_n
        self._pulls.add(swing_s, load_n, most_n)
        if self._accelerations:
            acceleration = self._acceleration
            some_n = min(load_n, explained_n + min(most_n, self._unexplained.most_n))
            moments = (acceleration, some_n, acceleration * some_n, acceleration * acceleration)
            self._moments = [
                sum_ + swing_s * moment for sum_, moment in zip(self._moments, moments, strict=True)
            ]
            self._unexplained.add(swing_s, max(load_n - explained_n, 0.0), most_n)
        share = swing_s / _SETTLES_S
        rise_n, most_n = above_n * (1.0 if share > 1.0 else share), self._max_swing_rise_n_per_s * swing_s
        self.swing_load_n += most_n if most_n < rise_n else rise_n

    def _update_spreads(self, t_s: float, baseline_error_n: float) -> None:
        """Derive what changes slowly: spreads of the load in swing, the mean of stances, and what drift explains."""
        elapsed_s, self._updated_s = min(max(t_s - self._updated_s, 0.0), _LONG_SILENCE_S), t_s
        kept = max(1.0 - elapsed_s / MEMORY_S, 0.0)
        if self.in_contact:
            self._stance_ns *= kept
            self._stance_s *= kept
        else:
            self._pulls.forget(kept)
            self._unexplained.forget(kept)
            self._moments = [kept * sum_ for sum_ in self._moments]
        pressing_n = max(0.0, self.load_n)  # of a number and NaN, in this order, the number
        self._creep_load_n += (pressing_n - self._creep_load_n) * (
            elapsed_s / (DRIFT_TIME_CONSTANT_S + elapsed_s)
        )
        creep_n = _MAX_CREEP_REL * self._creep_load_n
        self.drift_n = baseline_error_n + creep_n
        mean_n = (3.0 * _SHORTEST_STANCE_S * self._least_n + self._stance_ns) / (
            _SHORTEST_STANCE_S + self._stance_s
        )
        quiet_n2 = (SMALL_SHARE * self._least_n) ** 2
        expected_n2 = max((_PULL_REL * mean_n) ** 2, quiet_n2)
        self._pulls.update(expected_n2, quiet_n2)
        spread_n2 = self._pulls.spread_n2
        if self._accelerations and not self.in_contact:
            # At most all of the pull is unexplained, also before an acceleration has been known for long.
            self._unexplained.update(expected_n2, quiet_n2)
            spread_n2 = min(spread_n2, self._unexplained.spread_n2)
        left_n2 = (baseline_error_n / 3.0 + creep_n) ** 2 if self.in_contact else 0.0
        self._spread_n = math.sqrt(spread_n2 + left_n2)
        self._stance_load_n = _STANCE_LOAD_REL * mean_n
        self._shift_n = _PULL_REL * mean_n

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
