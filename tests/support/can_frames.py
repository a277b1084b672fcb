"""The data of single frames, as the frames of all legs are made."""

import math
from collections.abc import Sequence

from firmware_interface.can.codes import State
from firmware_interface.can.force import force_frames

_NAN_N = (math.nan, math.nan, math.nan)
_SIGMA_N = (0.01, 0.01, 0.01)


def encode_force(
    node: int, counter: int, state: int, force_n: Sequence[float], sigma_n: Sequence[float] = _SIGMA_N
) -> bytes:
    """Return the 8 data bytes of `Force`; arguments as in `Force`."""
    force, _ = force_frames([node], counter, 0, [0], [state], [force_n], [sigma_n], [0], [1.0], [1.0])
    return force[8:]


def encode_quality(
    node: int,
    counter: int,
    flags: int,
    age_ns: int | None,
    sigma_n: Sequence[float],
    contact_probability: float = 1.0,
    holds: float = 0.9,
) -> bytes:
    """Return the 8 data bytes of `Quality`; arguments as in `Quality`."""
    t_ns, t_sent_ns = (0, 0) if age_ns is None else (1, age_ns + 1)
    _, quality = force_frames(
        *([node], counter, t_sent_ns, [t_ns], [State.ABSENT], [_NAN_N], [sigma_n], [flags]),
        *([contact_probability], [holds]),
    )
    return quality[8:]
