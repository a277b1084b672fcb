"""Gait estimate of all legs, updated with every conversion: contact events, load share, ground normal, friction, slip.

Contact and its thresholds are those of `baseline.py`. Slip is looked for on half of the legs in turn, and what changes
slowly is computed for the published frames alone.

The network gives the contact point, hence the normal of the ground, and the friction ratio: tangential over normal
force. Slips show in that alone. A foot that sticks may have any ratio up to the coefficient of friction; one that
slides has that of the ground, whatever load and direction do. So a slide begins as a kink: the ratio rises, and stays.
A push of the body that ends looks the same, but at a ratio of its own each time, and one that a later stance exceeds.
Kinks at one ratio, of several stances, which nothing exceeds, are the cone of the ground. From then on a foot slides
where its ratio comes to the cone. A slope alone has no kink: its ratio is there from the touchdown on.

The ratio cannot distinguish a foot that sticks at the cone from one that slides there: both are reported as slips.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from footsense.estimation.back_dating import (
    N_BUFFERED_CONVERSIONS,
    BackDated,
    LegLoads,
    lift_off,
    touchdown,
)
from footsense.estimation.baseline import ContactDetector
from footsense.frames import GaitEvent, GaitEventKind, GaitFrame, Slip
from footsense.ports import LoadEstimate

#: Period of the frames without an event [ns].
GAIT_FRAME_PERIOD_NS = 100_000_000
#: Largest exponent of the probability: 1 - 1e-6.
_MAX_EXPONENT = 13.8
#: Slope of a logistic function over that of a normal distribution [1].
_LOGISTIC_SLOPE = 1.7
_NO_TIME = BackDated(0, math.nan)
#: State of a leg whose force is known and whose foot is in contact.
_FORCE_KNOWN_IN_CONTACT = (True, True)

#: Largest standard deviations with which a value is still given: direction [rad] and tangential over normal force [1].
_MAX_NORMAL_SIGMA_RAD, _MAX_FRICTION_SIGMA = 0.3, 0.2
#: Normal force from which the contact is learnt [N], and over its own standard deviation [1].
_MIN_PRESSING_N, _MIN_PRESSING_SIGMAS = 0.03, 4.0
#: Every second conversion is checked: the next one has mostly the same readings.
_CONVERSIONS_PER_CHECK = 2
#: Checks of a plateau, and the longest mean time between two of them [ns].
_PLATEAU_CHECKS, _LONGEST_CHECK_NS = 4, 8_000_000
#: Time before a plateau in which the ratio may have risen to it [ns]: a slide that begins suddenly is not clear at
#: first.
_PLATEAU_LOOKBACK_NS = 120_000_000
#: Tolerance of a ratio in standard deviations, the smallest one [1], and the largest for detecting a slip and
#: for finding a kink [1].
_TOLERANCE_SIGMAS, _MIN_TOLERANCE, _MAX_SLIP_TOLERANCE, _MAX_KINK_TOLERANCE = 1.5, 0.02, 0.12, 0.045
#: Rise of a kink in tolerances.
_MIN_KINK_RISE_TOLERANCES = 3.0
#: Kinks that are kept, and kinks at one ratio that make a cone.
_MAX_KINKS, _MIN_CLUSTER = 30, 4
#: Static over kinetic friction at most [1].
_MAX_STATIC_OVER_KINETIC = 1.2
#: Checks at the cone until a slip is reported, and away from it until it is over.
_SLIP_STARTS_AFTER, _SLIP_ENDS_AFTER = 2, 3
#: Normal force from which friction is learnt [N].
_MIN_LEARNING_FORCE_N = 0.15
#: From the beginning or end of a slip to the first estimate that shows it [ns].
_SLIP_DETECTION_LAG_NS = 9_600_000
#: Standard deviation of the time of a slip [s].
_SLIP_TIME_SIGMA_S = 0.01


class GroundEstimate(NamedTuple):
    """Estimated ground normal and tangential over normal force below one foot, with standard deviations.

    Attributes:
        pressing_n: Normal force [N].
        normal: Unit normal into the foot, foot frame.
        normal_sigma_rad: Standard deviation of its direction [rad].
        tangential_over_normal: Tangential over normal force [1].
        tangential_over_normal_sigma: Standard deviation of it [1].
    """

    pressing_n: float
    normal: tuple[float, float, float]
    normal_sigma_rad: float
    tangential_over_normal: float
    tangential_over_normal_sigma: float


_NAN = math.nan
NO_GROUND = GroundEstimate(_NAN, (_NAN, _NAN, _NAN), _NAN, _NAN, _NAN)


def ground_of(load: LoadEstimate, row: int) -> GroundEstimate:
    """Return ground normal and tangential over normal force below one foot; NaN where the load does not determine them.

    In Python numbers: for six legs, numpy's calls take longer.

    Args:
        load: Loads of all legs.
        row: Row of the foot's leg.
    """
    fx, fy, fz = load.force_n[row].tolist()
    px, py, rx, ry = load.contact_point_and_friction[row].tolist()
    sigma_px, sigma_py, sigma_rx, sigma_ry = load.contact_sigma[row].tolist()
    square = px * px + py * py
    scale = 1.0 / (1.0 + square)
    nx, ny, nz = 2.0 * px * scale, 2.0 * py * scale, (1.0 - square) * scale
    pressing_n = fx * nx + fy * ny + fz * nz
    if not (
        pressing_n > _MIN_PRESSING_N
        and pressing_n > _MIN_PRESSING_SIGMAS * load.sigma_n.item(row, 2)
        and nz > 0.0
    ):
        return NO_GROUND
    # The third component follows: the tangential force is perpendicular to the normal.
    rz = -(nx * rx + ny * ry) / nz
    ratio = math.sqrt(rx * rx + ry * ry + rz * rz)
    normal_sigma = 2.0 * scale * math.hypot(sigma_px, sigma_py)
    ratio_sigma = math.hypot(sigma_rx, sigma_ry) / math.sqrt(2.0)
    known_normal, known_ratio = normal_sigma < _MAX_NORMAL_SIGMA_RAD, ratio_sigma < _MAX_FRICTION_SIGMA
    return GroundEstimate(
        pressing_n,
        (nx, ny, nz) if known_normal else (_NAN, _NAN, _NAN),
        normal_sigma if known_normal else _NAN,
        ratio if known_ratio else _NAN,
        ratio_sigma if known_ratio else _NAN,
    )


class FrictionEstimator:
    """Estimator of the ground's friction coefficient from the slips of all legs.

    Attributes:
        coefficient: Coefficient of kinetic friction [1]; NaN as long as it is not known.
        exceeding_ratio: Least ratio that exceeds a kink [1]; infinite without one.
    """

    def __init__(self) -> None:
        self.coefficient = math.nan
        self.exceeding_ratio = math.inf
        self._kinks: deque[float] = deque(maxlen=_MAX_KINKS)

    def add_kink(self, ratio: float, tolerance: float) -> None:
        """Add the friction ratio at which a rise ended (a possible slip); once per stance."""
        self._kinks.append(ratio)
        self._update_coefficient(tolerance)

    def drop_exceeded_kinks(self, ratio: float, tolerance: float) -> None:
        """Remove ratios that a foot has exceeded without sliding, as they were no slips."""
        held = (ratio - tolerance) / _MAX_STATIC_OVER_KINETIC
        if min(self._kinks, default=math.inf) < held:
            self._kinks = deque((kink for kink in self._kinks if kink >= held), _MAX_KINKS)
            self._update_coefficient(tolerance)

    def _update_coefficient(self, ratio_tolerance: float) -> None:
        """Estimate the coefficient as the median of the highest cluster of ratios; NaN without one."""
        ordered = sorted(self._kinks, reverse=True)
        self.exceeding_ratio = _MAX_STATIC_OVER_KINETIC * min(ordered, default=math.inf)
        self.coefficient = math.nan
        for first in range(len(ordered) - _MIN_CLUSTER + 1):
            cluster = [kink for kink in ordered[first:] if kink > ordered[first] - 2.0 * ratio_tolerance]
            if len(cluster) >= _MIN_CLUSTER:
                self.coefficient = cluster[len(cluster) // 2]
                return


class SlipDetector:
    """Slip detector of one leg, from the plateaus of its friction ratio.

    Args:
        friction: Estimate of the coefficient of friction, shared by all legs.

    Attributes:
        state: Whether the foot slides.
    """

    def __init__(self, friction: FrictionEstimator) -> None:
        self._friction = friction
        self.reset_stance()

    def reset_stance(self) -> None:
        """Reset the state of the stance, after the foot has lifted off."""
        self.state = Slip.UNKNOWN
        # Time [ns] and ratio of the latest checks with a small tolerance.
        self._ratios: deque[tuple[int, float]] = deque()
        # Checks in a row at the cone or away from it, and the time of the first of them [ns].
        self._at_cone, self._run, self._since_ns = False, 0, 0
        self._kinked = False

    def observe(self, ground: GroundEstimate, now_ns: int) -> BackDated | None:
        """Process the newest friction ratio; return the time at which a slip started or ended, else None.

        Args:
            ground: The ground below the foot.
            now_ns: Current time [ns].
        """
        ratio = ground.tangential_over_normal
        if not ground.pressing_n > _MIN_LEARNING_FORCE_N or math.isnan(ratio):
            was_slipping = self.state is Slip.SLIPPING
            self.state, self._run = Slip.UNKNOWN, 0
            return BackDated(now_ns - _SLIP_DETECTION_LAG_NS, _SLIP_TIME_SIGMA_S) if was_slipping else None
        tolerance = max(_TOLERANCE_SIGMAS * ground.tangential_over_normal_sigma, _MIN_TOLERANCE)
        if tolerance > _MAX_SLIP_TOLERANCE:
            # As in the first scan of a stance; a reported slip continues.
            self._run = 0
            if self.state is Slip.NONE:
                self.state = Slip.UNKNOWN
            return None
        ratios = self._ratios
        ratios.append((now_ns, ratio))
        while ratios[0][0] < now_ns - _PLATEAU_LOOKBACK_NS:
            ratios.popleft()
        exceeds = ratio > self._friction.exceeding_ratio
        if tolerance <= _MAX_KINK_TOLERANCE and (exceeds or not self._kinked):
            self._find_kink(tolerance, exceeds=exceeds)
        cone = self._friction.coefficient
        at_cone = ratio > cone - _MIN_TOLERANCE
        if at_cone is not self._at_cone or not self._run:
            self._at_cone, self._run, self._since_ns = at_cone, 0, now_ns
        self._run += 1
        if self.state is not Slip.SLIPPING:
            self.state = Slip.UNKNOWN if math.isnan(cone) else Slip.NONE
        if at_cone is (self.state is Slip.SLIPPING) or self._run < (
            _SLIP_STARTS_AFTER if at_cone else _SLIP_ENDS_AFTER
        ):
            return None
        self.state = Slip.SLIPPING if at_cone else Slip.NONE
        return BackDated(self._since_ns - _SLIP_DETECTION_LAG_NS, _SLIP_TIME_SIGMA_S)

    def _find_kink(self, tolerance: float, *, exceeds: bool) -> None:
        """Search the latest ratios for a rise that ends in a plateau; `exceeds`: the newest is above the cone."""
        ratios = self._ratios
        if len(ratios) <= _PLATEAU_CHECKS:
            return
        plateau = [ratios[place][1] for place in range(-_PLATEAU_CHECKS, 0)]
        if (
            max(plateau) - min(plateau) > tolerance
            or ratios[-1][0] - ratios[-_PLATEAU_CHECKS][0] > _PLATEAU_CHECKS * _LONGEST_CHECK_NS
        ):
            return
        level = sum(plateau) / _PLATEAU_CHECKS
        if exceeds:
            self._friction.drop_exceeded_kinks(level, tolerance)
        if (
            not self._kinked
            and level - min(ratio for _, ratio in ratios) > _MIN_KINK_RISE_TOLERANCES * tolerance
        ):
            self._kinked = True
            self._friction.add_kink(level, tolerance)


class GaitTracker:
    """Gait estimator of all legs: contact events, load share, ground normal, friction, slip.

    Args:
        n_legs: Legs of a frame.
        period_ns: Period of the frames without an event [ns]; 0 for a frame of each conversion.
    """

    def __init__(self, n_legs: int, period_ns: int = GAIT_FRAME_PERIOD_NS) -> None:
        friction = FrictionEstimator()
        self._friction = friction
        self._slips = [SlipDetector(friction) for _ in range(n_legs)]
        self._loads: deque[LegLoads] = deque(maxlen=N_BUFFERED_CONVERSIONS)
        self._turn = 0
        self._period_ns, self._due_ns = period_ns, 0
        # Whether the force is known, and whether the foot is in contact, of each leg.
        self._states = [(False, False)] * n_legs
        self._touchdowns, self._lift_offs = [_NO_TIME] * n_legs, [_NO_TIME] * n_legs

    def observe(
        self, load: LoadEstimate, contacts: Sequence[ContactDetector], now_ns: int
    ) -> GaitFrame | None:
        """Process the loads of one conversion; return the gait if an event occurred or a frame is due, else None.

        Args:
            load: Loads of all legs as of `now_ns`; NaN forces where they may not be used.
            contacts: Contact of each leg, as of the same readings.
            now_ns: Current time [ns].
        """
        above_n, mean_n, states = [], [], []
        for force_n, contact in zip(load.force_n[:, 2].tolist(), contacts, strict=True):
            swing_load_n = contact.swing_load_n
            above_n.append(force_n - swing_load_n)
            mean_n.append(contact.load_n - swing_load_n)
            states.append((math.isfinite(force_n + contact.load_n), contact.in_contact))
        self._loads.append(LegLoads(now_ns, above_n, mean_n))
        events: list[GaitEvent] = []
        if states != self._states:
            for row, (before, now) in enumerate(zip(self._states, states, strict=True)):
                if now != before:
                    events += self._contact_events(row, before, now)
            self._states = states
        self._turn = (self._turn + 1) % _CONVERSIONS_PER_CHECK
        for row in range(self._turn, len(states), _CONVERSIONS_PER_CHECK):
            if states[row] == _FORCE_KNOWN_IN_CONTACT:
                slipped = self._slips[row].observe(ground_of(load, row), now_ns)
                if slipped is not None:
                    starts = self._slips[row].state is Slip.SLIPPING
                    kind = GaitEventKind.SLIP if starts else GaitEventKind.SLIP_END
                    events.append(GaitEvent(kind, row, *slipped))
        if not events and now_ns < self._due_ns:
            return None
        if now_ns >= self._due_ns and self._period_ns:
            self._due_ns = (now_ns // self._period_ns + 1) * self._period_ns
        return self._gait_frame(load, contacts, above_n, now_ns, tuple(events))

    def _contact_events(self, row: int, before: tuple[bool, bool], now: tuple[bool, bool]) -> list[GaitEvent]:
        # A contact that began or ended while the force was not known has no event, and no time.
        is_known, in_contact = now
        slip = self._slips[row]
        was_slipping = slip.state is Slip.SLIPPING
        if not (is_known and in_contact):
            slip.reset_stance()
        if before == (True, in_contact):
            return []
        if not (is_known and before[0]):
            if before[1] != in_contact:
                self._touchdowns[row] = self._lift_offs[row] = _NO_TIME
            return []
        if in_contact:
            kinds, dated = [GaitEventKind.TOUCHDOWN], touchdown(self._loads, row)
            own, other = self._touchdowns, self._lift_offs
        else:
            kinds, dated = [GaitEventKind.LIFT_OFF], lift_off(self._loads, row)
            own, other = self._lift_offs, self._touchdowns
            if was_slipping:
                kinds.insert(0, GaitEventKind.SLIP_END)
        # A foot cannot touch before it was lifted, nor be lifted before it touched.
        own[row] = BackDated(max(dated.t_ns, other[row].t_ns + 1), dated.sigma_s)
        return [GaitEvent(kind, row, *own[row]) for kind in kinds]

    def _gait_frame(
        self,
        load: LoadEstimate,
        contacts: Sequence[ContactDetector],
        above_n: list[float],
        now_ns: int,
        events: tuple[GaitEvent, ...],
    ) -> GaitFrame:
        known, contact = np.array(self._states, np.bool_).T
        pressing_n = np.where(contact, np.maximum(load.force_n[:, 2], 0.0), 0.0)
        total_n = float(pressing_n[known].sum())
        grounds = [
            ground_of(load, row) if state == _FORCE_KNOWN_IN_CONTACT else NO_GROUND
            for row, state in enumerate(self._states)
        ]
        _, normal, normal_sigma_rad, ratio, ratio_sigma = map(np.array, zip(*grounds, strict=True))
        touchdown_ns, touchdown_sigma_s = zip(*self._touchdowns, strict=True)
        lift_off_ns, lift_off_sigma_s = zip(*self._lift_offs, strict=True)
        return GaitFrame(
            t_ns=now_ns,
            contact=contact,
            contact_raw=np.array([leg.raw for leg in contacts]),
            probability=np.array([_contact_probability(*leg) for leg in zip(contacts, above_n, strict=True)]),
            touchdown_ns=np.array(touchdown_ns, np.int64),
            touchdown_sigma_s=np.array(touchdown_sigma_s),
            lift_off_ns=np.array(lift_off_ns, np.int64),
            lift_off_sigma_s=np.array(lift_off_sigma_s),
            load_share=np.where(known, pressing_n, np.nan) / (total_n or math.nan),
            normal=normal,
            normal_sigma_rad=normal_sigma_rad,
            tangential_over_normal=ratio,
            tangential_over_normal_sigma=ratio_sigma,
            slip=np.array([slip.state for slip in self._slips], np.uint8),
            friction=self._friction.coefficient,
            all_in_air=bool((known & ~contact).all()),
            events=events,
        )


def _contact_probability(contact: ContactDetector, above_n: float) -> float:
    """Return the probability of contact, from the load's distance to the threshold; NaN if unknown."""
    noise, predicted = contact.noise, contact.predicted_noise
    uncertain_n = contact.uncertain_n
    measured = (contact.load_n - contact.swing_load_n - max(noise.contact_n, uncertain_n)) / noise.sigma_n
    estimated = (above_n - max(predicted.contact_n, uncertain_n)) / predicted.sigma_n
    if not math.isfinite(measured + estimated):
        return math.nan
    sigmas = max(measured, estimated)
    return 1.0 / (1.0 + math.exp(-min(max(_LOGISTIC_SLOPE * sigmas, -_MAX_EXPONENT), _MAX_EXPONENT)))
