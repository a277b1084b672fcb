"""Fault types of a scene: the entries of its list `faults`.

Each class is one kind of fault; its name in the file is the class name in lower case:
`{at_s: 3.2, leg: rm, fault: stuck_sda}`. A fault lasts from `at_s` until `until_s`, or to the end without it. The
mechanism is simulated where the part is that fails: `wire_faults.py` for the wires, `chip_faults.py` for the chips of a
leg, `damage.py` for the foot, `disturbances.py` for what adds to its readings, `sim/can/` for the CAN bus.
"""

import math
import re
from bisect import bisect_right
from collections.abc import Iterable
from typing import Annotated, Generic, Literal, TypeVar, get_args

import msgspec
from msgspec import Meta

_T = TypeVar("_T")

#: Start and end [ns].
Span = tuple[float, float]


def in_any_span(spans: list[Span], t_ns: float) -> bool:
    """Return whether a time [ns] lies in one of the spans (start included, end excluded)."""
    for from_ns, until_ns in spans:  # noqa: SIM110 - `any` costs three times as much, and every transaction asks
        if from_ns <= t_ns < until_ns:
            return True
    return False


class Schedule(Generic[_T]):
    """Values, each active in a span of time; the lookup is cached until the next start or end.

    Args:
        entries: Span [ns] and value.

    Attributes:
        until_ns: Time up to which the last answer holds [ns].
    """

    def __init__(self, entries: Iterable[tuple[Span, _T]]) -> None:
        self._entries = tuple(entries)
        self._edges_ns = sorted({edge_ns for span_ns, _ in self._entries for edge_ns in span_ns})
        self._acting: tuple[_T, ...] = ()
        self._since_ns, self.until_ns = math.inf, -math.inf  # no answer yet

    def at(self, t_ns: float) -> tuple[_T, ...]:
        """Return the values that are active at a time [ns], in the order of the entries."""
        if not self._since_ns <= t_ns < self.until_ns:
            passed = bisect_right(self._edges_ns, t_ns)
            self._since_ns, self.until_ns = [-math.inf, *self._edges_ns, math.inf][passed : passed + 2]
            self._acting = tuple(
                value for (from_ns, until_ns), value in self._entries if from_ns <= t_ns < until_ns
            )
        return self._acting


_NS_PER_S = 1_000_000_000

Leg = Literal["lf", "lm", "lr", "rf", "rm", "rr", "l4", "r4"]
ElementIndex = Annotated[int, Meta(ge=0, le=8)]
LineIndex = Annotated[int, Meta(ge=0, le=2)]
Probability = Annotated[float, Meta(gt=0.0, le=1.0)]
#: Index of one of the robot's buses, in the order of its configuration.
BusIndex = Annotated[int, Meta(ge=0, le=5)]


def _snake_case(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


class _Fault(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="fault", tag=_snake_case
):
    """A fault that starts at a time."""

    at_s: Annotated[float, Meta(ge=0.0)]

    @property
    def at_ns(self) -> int:
        """Start of the fault [ns]."""
        return round(self.at_s * _NS_PER_S)


class _LastingFault(_Fault, frozen=True, kw_only=True):
    """A fault with an optional end time."""

    until_s: Annotated[float, Meta(gt=0.0)] | None = None

    @property
    def until_ns(self) -> float:
        """End of the fault [ns]; infinite for a permanent fault."""
        return math.inf if self.until_s is None else round(self.until_s * _NS_PER_S)

    @property
    def span_ns(self) -> Span:
        """Start and end of the fault [ns]."""
        return self.at_ns, self.until_ns


class _LegFault(_LastingFault, frozen=True, kw_only=True):
    """A fault of one leg."""

    leg: Leg


class _ElementFault(_LegFault, frozen=True, kw_only=True):
    """A fault of one element of a foot."""

    element: ElementIndex


# ---------------------------------------------------------------- the chips of a leg


class Absent(_LegFault, frozen=True, kw_only=True):
    """No chip of the leg answers: the leg's cable is unplugged."""


class NackAtRandom(_LegFault, frozen=True, kw_only=True):
    """Each acknowledge of the leg's chips is lost with probability `rate_rel`: a loose contact."""

    rate_rel: Probability


class CorruptReads(_LegFault, frozen=True, kw_only=True):
    """Each read from the leg has one flipped bit with probability `rate_rel`: noise on its I2C lines."""

    rate_rel: Probability


class StuckConverter(_LegFault, frozen=True, kw_only=True):
    """The leg's converter never finishes a conversion."""


class HungConverter(_Fault, frozen=True, kw_only=True):
    """The leg's converter converts nothing from then on, until it is reset: seen of FDC1004 (TI E2E 404389, 801150)."""

    leg: Leg


class WrongChip(_LegFault, frozen=True, kw_only=True):
    """An EEPROM answers at the address of the leg's converter."""


class BrownOut(_Fault, frozen=True, kw_only=True):
    """The leg's supply dips for a moment: its chips restart with their power-up settings."""

    leg: Leg


class SwitchIgnoresWrites(_LegFault, frozen=True, kw_only=True):
    """The leg's row switch acknowledges writes but does not switch."""


# ---------------------------------------------------------------- the wires of a bus


class StuckSda(_LegFault, frozen=True, kw_only=True):
    """The leg holds SDA low: while its mux channel is connected, no transaction passes, not even to the mux.

    Attributes:
        within_byte: Whether its chip was interrupted within a byte: nine clocks with SDA released end it, which only an
            adapter gives that does not compare the line with what it sends.
    """

    within_byte: bool = False


class StuckUpstreamBus(_LastingFault, frozen=True, kw_only=True):
    """SDA is held low between host and mux: no transaction passes."""

    bus: BusIndex = 0


class ArbitrationLost(_LastingFault, frozen=True, kw_only=True):
    """Another master wins the arbitration on the upstream bus with probability `rate_rel` per attempt."""

    bus: BusIndex = 0
    rate_rel: Probability


class MuxReset(_Fault, frozen=True, kw_only=True):
    """A supply dip resets the mux: all its channels are disconnected."""

    bus: BusIndex = 0


class MuxKeepsChannels(_LastingFault, frozen=True, kw_only=True):
    """The mux acknowledges each control byte, and keeps the channels that it has connected."""

    bus: BusIndex = 0


# ---------------------------------------------------------------- the foot and its lines


class ElementOpen(_ElementFault, frozen=True, kw_only=True):
    """An element has lost its electrode: only a trace's capacitance remains."""


class ElementShorted(_ElementFault, frozen=True, kw_only=True):
    """The two electrodes of an element touch: its row line is shorted to its column line."""


class ElementStuck(_ElementFault, frozen=True, kw_only=True):
    """An element's electrode has come off the rubber: its capacitance no longer follows the load."""


class ElementDrifts(_ElementFault, frozen=True, kw_only=True):
    """The capacitance of an element drifts at a constant rate, as by moisture; the drift remains after the end."""

    rate_ff_per_s: Annotated[float, Meta(ge=-1000.0, le=1000.0)]


class GapClosed(_ElementFault, frozen=True, kw_only=True):
    """Water fills an element's gap: the element reads as if the gap were closed."""


class BrokenRow(_LegFault, frozen=True, kw_only=True):
    """A row line is interrupted between the switch and the foot."""

    row: LineIndex


class BrokenColumn(_LegFault, frozen=True, kw_only=True):
    """A column line is interrupted between the converter's pin and the foot."""

    column: LineIndex


# ---------------------------------------------------------------- disturbances of readings

#: Amplitude of a disturbance at a converter's input [fF].
AmplitudeFf = Annotated[float, Meta(ge=-10_000.0, le=10_000.0)]
NoiseFf = Annotated[float, Meta(gt=0.0, le=10_000.0)]
_Duration = Annotated[float, Meta(gt=0.0, le=1e5)]


class _Disturbance(_LastingFault, frozen=True, kw_only=True):
    """A disturbance of the readings of some legs.

    Attributes:
        legs: The legs; all by default.
    """

    legs: tuple[Leg, ...] = get_args(Leg)


class WhiteNoise(_Disturbance, frozen=True, kw_only=True):
    """Noise on every reading beside the converter's own: a motor cable beside the foot's.

    Attributes:
        noise_ff: Standard deviation [fF].
        common_rel: Share of its variance that all readings of a leg have in common, and that changes slowly [1].
    """

    noise_ff: NoiseFf
    common_rel: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0


class Tone(_Disturbance, frozen=True, kw_only=True):
    """A sine on every reading, averaged over each conversion and aliased by the scan: a motor's commutation, mains."""

    amplitude_ff: AmplitudeFf
    frequency_hz: Annotated[float, Meta(gt=0.0, le=1e6)]


class NoiseBursts(_Disturbance, frozen=True, kw_only=True):
    """White noise for the first `active_s` of each period: a motor that works in one phase of the gait."""

    noise_ff: NoiseFf
    period_s: _Duration
    active_s: _Duration


class Impulses(_Disturbance, frozen=True, kw_only=True):
    """Single readings off by `amplitude_ff`, each with a probability: sparks, electrostatic discharge."""

    amplitude_ff: AmplitudeFf
    rate_rel: Probability


class GroundShift(_Disturbance, frozen=True, kw_only=True):
    """All nine readings shift alike: the potential of the ground around a foot, or its shield, changes."""

    amplitude_ff: AmplitudeFf


class ColumnShift(_Disturbance, frozen=True, kw_only=True):
    """The readings of a column shift: the cable of its line moves, or gets moist."""

    amplitude_ff: AmplitudeFf
    column: LineIndex


class RowShift(_Disturbance, frozen=True, kw_only=True):
    """The readings of a row shift: the cable of its line moves, or gets moist."""

    amplitude_ff: AmplitudeFf
    row: LineIndex


class Leakage(_Disturbance, frozen=True, kw_only=True):
    """A wet tail of the foot: columns shift unevenly, the first the most, towards `amplitude_ff`."""

    amplitude_ff: AmplitudeFf
    time_constant_s: _Duration = 2.0


class MetalBesideTail(_Disturbance, frozen=True, kw_only=True):
    """Grounded metal lies 1 mm beside the tail, on the side of its lines; how much it adds is in the foot's table."""


class ChannelsShifted(_Disturbance, frozen=True, kw_only=True):
    """Each measurement converts the next pin: seen of FDC1004 after a reset (TI E2E 1217779)."""


# ---------------------------------------------------------------- the CAN bus


class CanNoAck(_LastingFault, frozen=True, kw_only=True):
    """No other CAN node acknowledges: the plug is out, or the receiver is off."""


class CanBusOff(_LastingFault, frozen=True, kw_only=True):
    """CANH and CANL are shorted: no bit passes, and the controller repeatedly goes bus-off."""


class CanDown(_LastingFault, frozen=True, kw_only=True):
    """The CAN interface is down, or was unplugged and replaced by a new one."""

    unplugged: bool = False


class CanQueueFull(_LastingFault, frozen=True, kw_only=True):
    """Another program on the same computer floods the transmit queue with frames of the lowest priority."""

    rate_hz: Annotated[float, Meta(gt=0.0, le=100_000.0)] = 10_000.0


class CanTraffic(_LastingFault, frozen=True, kw_only=True):
    """Another CAN node sends 8-byte frames periodically."""

    can_id: Annotated[int, Meta(ge=0, le=0x7FF)] = 0x080
    rate_hz: Annotated[float, Meta(gt=0.0, le=10_000.0)]


ChipFault = (
    Absent
    | NackAtRandom
    | CorruptReads
    | StuckConverter
    | HungConverter
    | WrongChip
    | BrownOut
    | SwitchIgnoresWrites
)
WireFault = StuckSda | StuckUpstreamBus | ArbitrationLost | MuxReset | MuxKeepsChannels
FootDamage = (
    ElementOpen | ElementShorted | ElementStuck | ElementDrifts | GapClosed | BrokenRow | BrokenColumn
)
Disturbance = (
    WhiteNoise
    | Tone
    | NoiseBursts
    | Impulses
    | GroundShift
    | ColumnShift
    | RowShift
    | Leakage
    | MetalBesideTail
    | ChannelsShifted
)
CanFault = CanNoAck | CanBusOff | CanDown | CanQueueFull | CanTraffic
Fault = ChipFault | WireFault | FootDamage | Disturbance | CanFault
