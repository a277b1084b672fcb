"""Gait semantics of one leg."""

import math

from footsense.estimation.baseline.contact import ContactDetector
from footsense.estimation.gait.back_dating import BackDated, BackDating
from footsense.estimation.gait.frame import EventKind, Slip
from footsense.estimation.gait.ground import NO_GROUND, Ground, ground_of
from footsense.estimation.gait.slip import Friction, SlipDetector

#: From the beginning of a slip until it is said, and the spread of that: three conversions and a lag of the readings.
_SLIP_LAG_NS, _SLIP_SIGMA_S = 15_000_000, 0.01
_NEVER = BackDated(0, math.nan)
#: Largest exponent of the probability: 1 - 1e-6.
_SURE = 13.8
#: Slope of a logistic function over that of a normal distribution [1].
_LOGISTIC = 1.7


class LegGait:
    """Gait semantics of one leg.

    Args:
        friction: What the slips of all legs teach.

    Attributes:
        contact: Debounced contact.
        raw: Whether the newest load alone is one of contact.
        known: Whether the force is known.
        probability: Probability of contact now [1], NaN where the force is not known.
        touchdown: Last touchdown.
        lift_off: Last lift-off.
        ground: Normal and use of friction.
        slip: Whether the foot slides.
    """

    def __init__(self, friction: Friction) -> None:
        self._slip = SlipDetector(friction)
        self._back_dating = BackDating()
        self.contact = self.raw = self.known = False
        self.probability = math.nan
        self.touchdown = self.lift_off = _NEVER
        self.ground: Ground = NO_GROUND

    def observe(
        self,
        contact: ContactDetector,
        force_n: list[float],
        sigma_n: list[float],
        point: list[float],
        point_sigma: list[float],
        now_ns: int,
    ) -> list[tuple[EventKind, BackDated]]:
        """Follow the leg by one conversion, and return its events.

        Args:
            contact: Contact, as of the same reading.
            force_n: Force as of `now_ns` [N]; NaN where it is not known.
            sigma_n: Standard deviation of each component [N].
            point: Contact point and friction ratio, as in `ports.Load`.
            point_sigma: Standard deviation of each.
            now_ns: Current time [ns].
        """
        above_n = force_n[2] - contact.floor_n
        self.known = math.isfinite(above_n) and math.isfinite(contact.load_n)
        if not self.known:
            self.probability, self.ground = math.nan, NO_GROUND
            self._slip.lift()
            self._back_dating.clear()
            if self.contact and not contact.in_contact:
                # Contact was lost for want of readings: there is no lift-off to tell.
                self.contact = self.raw = False
            return []
        back_dating, was = self._back_dating, self.contact
        back_dating.add(now_ns, above_n, contact.load_n - contact.floor_n)
        self.contact, self.raw = contact.in_contact, contact.raw
        noise, predicted = contact.noise, contact.predicted_noise
        self.probability = _probability(
            max(
                (contact.load_n - contact.floor_n - noise.threshold_n) / noise.sigma_n,
                (above_n - predicted.threshold_n) / predicted.sigma_n,
            )
        )
        if not self.contact:
            self.ground = NO_GROUND
            if not was:
                return []
            self._slip.lift()
            dated = back_dating.lift_off()
            self.lift_off = BackDated(max(dated.t_ns, self.touchdown.t_ns + 1), dated.sigma_s)
            return [(EventKind.LIFT_OFF, self.lift_off)]
        self.ground = ground_of(force_n, sigma_n, point, point_sigma)
        events = []
        if self._slip.observe(self.ground):
            events.append((EventKind.SLIP, BackDated(now_ns - _SLIP_LAG_NS, _SLIP_SIGMA_S)))
        if was:
            return events
        dated = back_dating.touchdown()
        # A foot cannot touch before it was lifted.
        self.touchdown = BackDated(max(dated.t_ns, self.lift_off.t_ns + 1), dated.sigma_s)
        return [(EventKind.TOUCHDOWN, self.touchdown), *events]

    @property
    def slip(self) -> Slip:
        """Whether the foot slides."""
        return self._slip.state


def _probability(sigmas: float) -> float:
    """Return the probability of contact by the load's distance from the threshold in standard deviations."""
    return 1.0 / (1.0 + math.exp(-min(max(_LOGISTIC * sigmas, -_SURE), _SURE)))
