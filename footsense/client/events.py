"""Gait events as users get them, live and in recordings."""

from typing import Literal, NamedTuple, cast

from firmware_interface.can.codes import GaitEventKind


class FootEvent(NamedTuple):
    """A touchdown, a lift-off, or a slip of one foot, reported once.

    A contact that began or ended while the leg was not usable for more than 250 ms has no event: take the leg's
    `contact` when it is usable again, and expect two events of a kind in a row.

    Attributes:
        t_s: When it happened, dated back [s]: in a `Recording` on the axis of its `t_s`, received live on that of
            `time.monotonic()`; NaN if it is not known.
        leg: Name of the leg.
        kind: What happened: `touchdown`, `lift_off`, `slip` (it begins) or `slip_end`; slips come only where the
            robot's configuration has `contact.friction`.
        sigma_s: Standard deviation of the time [s], NaN if it is not known.
    """

    t_s: float
    leg: str
    kind: Literal["touchdown", "lift_off", "slip", "slip_end"]
    sigma_s: float

    @classmethod
    def of(cls, t_s: float, leg: str, kind: GaitEventKind, sigma_s: float) -> "FootEvent":
        """Return the event of a kind as frames have it."""
        word = cast("Literal['touchdown', 'lift_off', 'slip', 'slip_end']", kind.name.lower())
        return cls(t_s, leg, word, sigma_s)
