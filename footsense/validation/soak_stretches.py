"""The stretches of a day of walking, each another way to walk."""

import msgspec
import numpy as np

__all__ = ["Stretch", "day"]

#: Hours of a day at the full rate.
_FAST_HOURS = 4.0
#: How many stretches have a stand, and from when until when [s].
_STANDS, _STAND_S = 2, (1200.0, 3000.0)


class Stretch(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the day.

    Attributes:
        number: Its place in the day.
        seed: Of all that is random in it.
        hours: How long it lasts [h].
        rate_sps: Conversions per second; at 100 the robot walks at a quarter of its pace.
        publish: `frame` or `element`.
        stands_s: From when until when the robot stands [s].
        kelvin: By how much it gets warmer, over ten minutes [K].
    """

    number: int
    seed: int
    hours: float
    rate_sps: int = 400
    publish: str = "frame"
    stands_s: tuple[tuple[float, float], ...] = ()
    kelvin: float = 0.0


def day(hours: float, seed: int) -> list[Stretch]:
    """Return the stretches of a walk: with a force after each conversion, two stands, and warmth that comes and goes.

    A day has four hours at 400 conversions a second, one of them with a force after each, and the rest at 100, which
    takes a third of the time. What is shorter than four hours is one stretch of each way of walking.
    """
    if hours <= _FAST_HOURS:
        length = hours / 3.0
        ways = [
            Stretch(number=0, seed=0, hours=length),
            Stretch(number=0, seed=0, hours=length, publish="element"),
            Stretch(number=0, seed=0, hours=length, rate_sps=100),
        ]
    else:
        ways = [
            Stretch(number=0, seed=0, hours=1.0, publish="element"),
            Stretch(number=0, seed=0, hours=1.0),
            Stretch(number=0, seed=0, hours=1.0, kelvin=20.0),
            Stretch(number=0, seed=0, hours=1.0, kelvin=-20.0),
        ]
        slow = [min(2.0, hours - begun) for begun in np.arange(_FAST_HOURS, hours, 2.0).tolist()]
        ways += [
            Stretch(
                number=0,
                seed=0,
                hours=length,
                rate_sps=100,
                stands_s=(_STAND_S,) if number < _STANDS and length * 3600.0 > _STAND_S[1] + 600.0 else (),
            )
            for number, length in enumerate(slow)
        ]
    return [
        msgspec.structs.replace(stretch, number=number, seed=1000 * seed + number)
        for number, stretch in enumerate(ways)
    ]
