"""What breaks in a scene, and when: the entries of its `faults`.

Each class is one fault; its name in the file is the class's in lower case: `{at_s: 3.2, leg: rm, fault: stuck_sda}`.
Where `until_s` may stand, the fault ends there, else it is for good. What a fault does stands where the part is that
it breaks: `bus_faults.py` for the bus, `chip_faults.py` for a leg's chips, `damage.py` for its foot,
`can_faults.py` and `sim/can/` for the CAN bus.
"""

import math
import re
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from footsense.frames import ELEMENTS
from footsense.sim.faults.can_faults import CanFault

_NS_PER_S = 1_000_000_000

Leg = Literal["lf", "lm", "lr", "rf", "rm", "rr"]
Element = Annotated[int, Meta(ge=0, le=ELEMENTS - 1)]
Line = Annotated[int, Meta(ge=0, le=2)]
Rate = Annotated[float, Meta(gt=0.0, le=1.0)]

#: A time at which something begins, and one at which it is over [ns].
Span = tuple[float, float]


def during(spans: list[Span], t_ns: float) -> bool:
    """Tell whether a time lies in one of the spans."""
    for from_ns, until_ns in spans:  # noqa: SIM110 - `any` costs three times as much, and every transaction asks
        if from_ns <= t_ns < until_ns:
            return True
    return False


def _tag(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


class _Fault(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="fault", tag=_tag
):
    at_s: Annotated[float, Meta(ge=0.0)]

    @property
    def at_ns(self) -> int:
        """When it happens [ns]."""
        return round(self.at_s * _NS_PER_S)


class _Lasting(_Fault, frozen=True, kw_only=True):
    until_s: Annotated[float, Meta(gt=0.0)] | None = None

    @property
    def span_ns(self) -> Span:
        """From when until when [ns]."""
        return self.at_ns, math.inf if self.until_s is None else round(self.until_s * _NS_PER_S)


class _OnLeg(_Lasting, frozen=True, kw_only=True):
    leg: Leg


class _OnBus(_Lasting, frozen=True, kw_only=True):
    #: Which of the robot's buses, in the order of its configuration.
    bus: Annotated[int, Meta(ge=0, le=5)] = 0


# ---------------------------------------------------------------- the chips of a leg


class Absent(_OnLeg, frozen=True, kw_only=True):
    """The leg's chips do not answer: its cable is off."""


class NackAtRandom(_OnLeg, frozen=True, kw_only=True):
    """The leg's chips now and then do not acknowledge: a loose contact."""

    rate_rel: Rate


class Garbled(_OnLeg, frozen=True, kw_only=True):
    """Now and then a bit of what is read from the leg is wrong: noise on its lines."""

    rate_rel: Rate


class StuckConverter(_OnLeg, frozen=True, kw_only=True):
    """The leg's conversions no longer finish."""


class WrongChip(_OnLeg, frozen=True, kw_only=True):
    """An EEPROM answers at the converter's address."""


class BrownOut(_Fault, frozen=True, kw_only=True):
    """The leg's supply fails for a moment: its chips answer on, with the settings of power-up."""

    leg: Leg


class DeafSwitch(_OnLeg, frozen=True, kw_only=True):
    """The leg's row switch acknowledges its settings and ignores them."""


# ---------------------------------------------------------------- the wires of a bus


class StuckSda(_OnLeg, frozen=True, kw_only=True):
    """The leg holds SDA low: nothing gets through on its bus, the mux included, while its channel is connected."""


class StuckTrunk(_OnBus, frozen=True, kw_only=True):
    """SDA is held low on the trunk itself."""


class ArbitrationLost(_OnBus, frozen=True, kw_only=True):
    """Another master on the trunk wins now and then."""

    rate_rel: Rate


class MuxLost(_Fault, frozen=True, kw_only=True):
    """The mux forgets which channels it connects: a dip of its supply."""

    bus: Annotated[int, Meta(ge=0, le=5)] = 0


# ---------------------------------------------------------------- the foot and its lines


class ElementOpen(_OnLeg, frozen=True, kw_only=True):
    """An element has lost its electrode."""

    element: Element


class ElementShorted(_OnLeg, frozen=True, kw_only=True):
    """The two electrodes of an element touch: its row is tied to its column."""

    element: Element


class ElementStuck(_OnLeg, frozen=True, kw_only=True):
    """An electrode has come off the rubber: its gap stays as it was, whatever the foot does."""

    element: Element


class ElementDrifts(_OnLeg, frozen=True, kw_only=True):
    """An element's capacitance runs away, as that of a film that takes up water; it stays where it was at the end."""

    element: Element
    rate_ff_per_s: Annotated[float, Meta(ge=-1000.0, le=1000.0)]


class GapShut(_OnLeg, frozen=True, kw_only=True):
    """Water has filled a gap: it reads as if it were shut."""

    element: Element


class BrokenRow(_OnLeg, frozen=True, kw_only=True):
    """The line of a row is interrupted between the switch and the foot."""

    row: Line


class BrokenColumn(_OnLeg, frozen=True, kw_only=True):
    """The line of a column is interrupted between the converter's pin and the foot."""

    column: Line


OnChips = Absent | NackAtRandom | Garbled | StuckConverter | WrongChip | BrownOut | DeafSwitch
OnWires = StuckSda | StuckTrunk | ArbitrationLost | MuxLost
OnFoot = ElementOpen | ElementShorted | ElementStuck | ElementDrifts | GapShut | BrokenRow | BrokenColumn
Fault = OnChips | OnWires | OnFoot | CanFault
