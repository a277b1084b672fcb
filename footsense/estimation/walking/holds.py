"""Whether a foot holds: the probability that it stands still on the ground, from the ratio of its forces.

A foot that slides has the ratio of tangential to normal force that is the ground's coefficient of friction, whatever
load and direction do; one that holds has less. So a foot on the ground has two states, and its ratio a likelihood in
each (Coulomb's law; a hidden Markov model, as contact is):

- What a gait asks of the ground is distributed as Rayleigh's, of scale one. The ground gives its coefficient at most: a
  foot of which less is asked holds, and has that ratio; one of which more is asked slides, and has the coefficient.
  This gives the ratio's likelihood in both states, and the probability of a slide before anything is known of a stance.
- The ratio has the estimate's sigma, the coefficient has its own. The network underestimates large ratios in shares of
  its sigma, as few of its training's loads have them: what is expected of a foot that slides is less by as much.

Errors of an estimate last: evidence counts by the time, and of one ratio not more than a few times.

The coefficient is that of the configuration or an assumed one, and follows what the feet show, all together: ratios
above it raise it, and those of feet that slide move it, as in expectation maximisation. It does not fall by more than
two sigma: a gait that asks little repeats its largest ratio in every stance, as a slide does.
"""

import math

from footsense.estimation.settings import CORRELATED_S, MEMORY_S
from footsense.estimation.walking.contact import LOGISTIC

#: Slides and their ends a second [1/s].
_CHANGES_PER_S = 2.0
#: Time in which the error of a ratio stays the same [s], by which a slip is dated back as well, and how often one ratio
#: counts in a stance at most [1].
SAME_ERROR_S, _MOST_COUNTED = 3.0 * CORRELATED_S, 3.0
#: By how much a ratio is underestimated, over its sigma and its square [1].
_SHORT = 3.0
#: Coefficient that is assumed where none is known, and standard deviation of any over itself [1].
_ASSUMED_FRICTION, _FRICTION_SIGMA_REL = 0.5, 0.2
#: How much more a ratio above the coefficient counts than one below it [1].
_ABOVE_COUNTS = 2.0
#: Odds of a slide from which a slip is reported, if the ratio supports it, and below which it is over.
_SLIPS, _SLIPS_NO_MORE = 1.0, 0.5
_LOG_ROOT_2_PI = 0.5 * math.log(2.0 * math.pi)


def ratio_sigma(ratio: float, sigma: float) -> float:
    """Return the standard deviation of a friction ratio with what it may be underestimated by [1].

    Args:
        ratio: The ratio [1].
        sigma: Its standard deviation without that [1].
    """
    return sigma * math.hypot(1.0, _SHORT * ratio * ratio)


class GroundFriction:
    """Coefficient of friction of the ground below all feet.

    Args:
        configured: The coefficient [1]; NaN where it is not known.

    Attributes:
        mean: The coefficient as it is known now [1].
        variance: Square of its standard deviation [1].
        log_odds: Log odds of a slide of a foot of which nothing else is known.
        odds: The same as odds [1].
        log_density: Logarithm of the factor of the density of a ratio of a foot that holds, over that one of a slide.
    """

    def __init__(self, configured: float) -> None:
        self._start = configured if math.isfinite(configured) else _ASSUMED_FRICTION
        sigma = _FRICTION_SIGMA_REL * self._start
        self._start_variance, self._least = sigma * sigma, self._start - 2.0 * sigma
        self.mean, self.variance = self._start, self._start_variance
        self.pass_time(0.0)

    def pass_time(self, elapsed_s: float) -> None:
        """Forget what the feet have shown, as far as time has passed [s]."""
        forgotten = min(elapsed_s / MEMORY_S, 1.0)
        self.mean += forgotten * (self._start - self.mean)
        self.variance += forgotten * (self._start_variance - self.variance)
        exponent = 0.5 * self.mean * self.mean
        self.odds = 1.0 / math.expm1(exponent)
        self.log_odds = math.log(self.odds)
        self.log_density = -_LOG_ROOT_2_PI - exponent - self.log_odds

    def follow(self, apart: float, variance: float, weight: float) -> None:
        """Follow the ratio of a foot.

        Args:
            apart: The ratio, less what is expected of a foot that slides [1].
            variance: Square of the ratio's standard deviation [1].
            weight: How much it counts [1].
        """
        counts = weight / variance
        if apart > 0.0:
            counts *= _ABOVE_COUNTS
        self.variance /= 1.0 + counts * self.variance
        self.mean = max(self.mean + self.variance * counts * apart, self._least)


class Holding:
    """Whether one foot on the ground stands still; in plain Python numbers, faster than arrays for six legs.

    Args:
        friction: The ground's friction.

    Attributes:
        slips: Whether slips are reported.
        is_known: Whether a ratio of this stance was known.
        probability: Probability that the foot stands still if it is on the ground [1].
        since_ns: Since when a slide has been more likely than not, or not any more [ns]; 0 before a look at the stance.
    """

    def __init__(self, friction: GroundFriction) -> None:
        self._friction = friction
        self.reset_stance()

    def reset_stance(self) -> None:
        """Forget the stance, after the foot has lifted off."""
        self.slips = self.is_known = False
        self.since_ns = 0
        # Odds of a slide.
        self._odds = self._friction.odds
        self.probability = 1.0 / (1.0 + self._odds)

    def observe(self, ratio: float, sigma: float, elapsed_s: float, now_ns: int) -> bool:
        """Process the newest friction ratio of a foot on the ground; return whether a slip begins or ends.

        Args:
            ratio: Tangential over normal force [1], NaN where it is not known.
            sigma: Standard deviation of it [1], same.
            elapsed_s: Time since the last call of the stance [s].
            now_ns: Current time [ns].
        """
        friction, before = self._friction, self._odds
        changes = _CHANGES_PER_S * elapsed_s
        ends = changes / (1.0 + friction.odds)
        begins = changes - ends
        odds = (before * (1.0 - ends) + begins) / (1.0 - begins + before * ends)
        speaks_for_slide = False
        if not math.isnan(ratio):
            self.is_known = True
            mean, variance = friction.mean, sigma * sigma
            expected = mean * max(1.0 - _SHORT * sigma * mean, 0.5)
            spread = math.sqrt(variance + friction.variance)
            # Above the coefficient no foot holds.
            apart, asked = (ratio - expected) / spread, spread if spread > ratio else ratio
            apart = LOGISTIC if apart > LOGISTIC else apart
            asked = expected if expected < asked else asked
            evidence = friction.log_density + 0.5 * (asked * asked - apart * apart)
            evidence += math.log((1.0 + math.exp(LOGISTIC * apart)) / (spread * asked))
            weight = min(elapsed_s / SAME_ERROR_S, 1.0)
            # As far as the ratio alone says it.
            limit = math.exp(friction.log_odds + _MOST_COUNTED * evidence)
            if (limit > odds) is (evidence > 0.0):
                counted = odds * math.exp(weight * evidence)
                odds = min(counted, limit) if evidence > 0.0 else max(counted, limit)
            speaks_for_slide = evidence > 0.0
            # By how much more a slide is likely than before anything was known of the stance.
            shown = (odds - friction.odds) / (1.0 + odds)
            if shown > 0.0:
                friction.follow(ratio - expected, variance, weight * shown)
        self._odds, self.probability = odds, 1.0 / (1.0 + odds)
        if (odds > 1.0) is not (before > 1.0) or not self.since_ns:
            self.since_ns = now_ns
        if odds < _SLIPS_NO_MORE if self.slips else speaks_for_slide and odds > _SLIPS:
            self.slips = not self.slips
            return True
        return False
