"""Gait semantics of all legs after one conversion."""

from enum import IntEnum
from typing import NamedTuple

from footsense.frames import Codes, Mask, Stamps, Vector


class Slip(IntEnum):
    """Whether a foot in contact slides."""

    UNKNOWN = 0  #: no contact, or too little load to tell
    NONE = 1
    SLIPPING = 2


class EventKind(IntEnum):
    """Kind of a gait event."""

    TOUCHDOWN = 0
    LIFT_OFF = 1
    SLIP = 2


class GaitEvent(NamedTuple):
    """Something that happened to one leg; each is reported once.

    Attributes:
        kind: Kind of event.
        leg: Row of the leg in the frames.
        t_ns: Time at which it happened [ns], back-dated.
        sigma_s: Standard deviation of that time [s].
    """

    kind: EventKind
    leg: int
    t_ns: int
    sigma_s: float


class GaitFrame(NamedTuple):
    """Gait semantics of all legs, as of one time.

    Attributes:
        t_ns: The time [ns].
        contact: Debounced contact, shape (legs,).
        contact_raw: Whether the newest load alone is one of contact, shape (legs,).
        probability: Probability of contact now [1], shape (legs,), NaN where the force is not known.
        touchdown_ns: Time of the last touchdown, back-dated [ns], shape (legs,); 0 before the first.
        touchdown_sigma_s: Standard deviation of it [s], shape (legs,), NaN before the first.
        lift_off_ns: Time of the last lift-off, back-dated [ns], shape (legs,); 0 before the first.
        lift_off_sigma_s: Standard deviation of it [s], shape (legs,), NaN before the first.
        load_share: Share of the load that all legs in contact carry along their legs [1], shape (legs,); 0 for a foot
            in the air, NaN for a leg without a force and where no leg carries anything.
        normal: Unit normal of the ground into the foot, foot frame, shape (legs, 3), NaN where no load tells it.
        normal_sigma_rad: Standard deviation of its direction, root of the sum of both squares [rad], shape (legs,).
        friction_use: Tangential over normal force [1], shape (legs,), NaN where no load tells it.
        friction_use_sigma: Standard deviation of it [1], shape (legs,).
        slip: Whether the foot slides, shape (legs,), uint8 of `Slip`.
        friction: Coefficient of the ground's friction, learnt from the slips of all legs [1]; NaN until enough slipped.
        all_in_air: Whether every leg is known to be without contact.
        events: What happened since the last frame.
    """

    t_ns: int
    contact: Mask
    contact_raw: Mask
    probability: Vector
    touchdown_ns: Stamps
    touchdown_sigma_s: Vector
    lift_off_ns: Stamps
    lift_off_sigma_s: Vector
    load_share: Vector
    normal: Vector
    normal_sigma_rad: Vector
    friction_use: Vector
    friction_use_sigma: Vector
    slip: Codes
    friction: float
    all_in_air: bool
    events: tuple[GaitEvent, ...]
