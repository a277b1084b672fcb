"""A conversion that runs on several legs at once."""

from typing import NamedTuple

from footsense.acquisition.leg_connection import LegLink
from footsense.acquisition.scan_plan import Step
from footsense.frames import Reading


class Conversion(NamedTuple):
    """A conversion that was triggered on some legs.

    Attributes:
        step: Which.
        t_start_ns: When its trigger had gone out [ns].
        legs: The legs that were told to convert; none if a transaction failed.
        selected: Whether lines were selected for it, or left from the step before.
        unread: What a leg that gives no reading of it has to say.
    """

    step: Step
    t_start_ns: int
    legs: tuple[LegLink, ...]
    selected: bool
    unread: Reading


def channels(legs: tuple[LegLink, ...]) -> list[int]:
    """Return the mux channels of some legs."""
    return [leg.channel for leg in legs]
