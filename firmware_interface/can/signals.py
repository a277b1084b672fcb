"""Signals of the CAN frames: how a value becomes bits, and the codec of a frame from the table of its signals.

The content of a frame is a named tuple: node, counter, and a field for each signal, annotated with its place in the
frame. That table is all that `Codec` needs; bits that no signal has are 0. Bit 0 is the least significant of byte 0.
"No value" has a code of its own, apart from that of a number too large for its field, so that neither passes for a
measurement.

Units:
    Ages ns; numbers in those of the field.
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from typing import Any, Generic, TypeVar, get_args, get_type_hints

from firmware_interface.can.crc8 import FrameError, check_frame_and_get_counter, node_of, protect
from firmware_interface.can.socketcan import pack_frame

#: Rounds up, except for the rounding error of a whole number of bits.
CEILING_OFFSET = 1 - 1e-6

Value = TypeVar("Value")
Content = TypeVar("Content", bound=tuple[Any, ...])


@dataclass(frozen=True)
class CanSignal(Generic[Value]):
    """Part of a frame that stands for one value.

    Attributes:
        first_bit: Its first bit in the frame.
        n_bits: Number of its bits.
    """

    first_bit: int
    n_bits: int

    @property
    def end_bit(self) -> int:
        """First bit behind it."""
        return self.first_bit + self.n_bits

    @abstractmethod
    def to_code(self, value: Value) -> int:
        """Return the code of a value."""

    @abstractmethod
    def to_value(self, code: int) -> Value:
        """Return the value of a code."""


@dataclass(frozen=True)
class Code(CanSignal[int]):
    """An integer, a truth value, or a member of an enumeration, which has to fit."""

    def to_code(self, value: int) -> int:
        """Return the value itself."""
        return int(value)

    def to_value(self, code: int) -> int:
        """Return the code itself."""
        return code


@dataclass(frozen=True)
class Number(CanSignal[float]):
    """A number, limited to its range; NaN is no value, and so is a negative number in an unsigned field.

    Unsigned the largest code is no value and the one before it the largest number, signed the least code is no value.

    Attributes:
        per_unit: Codes per unit.
        signed: Whether it has a sign.
        up: Whether it is rounded up, as a standard deviation must never look smaller than it is.
    """

    per_unit: int
    signed: bool = False
    up: bool = False

    def to_code(self, value: float) -> int:
        """Return the code of a number."""
        if self.signed:
            most = (1 << self.n_bits - 1) - 1
            return -most - 1 if math.isnan(value) else round(max(-most, min(most, value * self.per_unit)))
        none = (1 << self.n_bits) - 1
        if not value >= 0.0:
            return none
        return min(int(min(value * self.per_unit, none) + (CEILING_OFFSET if self.up else 0.5)), none - 1)

    def to_value(self, code: int) -> float:
        """Return the number of a code."""
        sign = 1 << self.n_bits - 1
        if self.signed:
            code = (code ^ sign) - sign
        return math.nan if code == (-sign if self.signed else 2 * sign - 1) else code / self.per_unit


@dataclass(frozen=True)
class Vector(CanSignal[Sequence[float]]):
    """A vector of three numbers one behind the other; the third of a unit vector may be left out.

    Attributes:
        part: One of the numbers.
    """

    part: Number

    def to_code(self, value: Sequence[float]) -> int:
        """Return the codes of the components as one."""
        mask = (1 << self.part.n_bits) - 1
        places = range(0, self.n_bits, self.part.n_bits)
        return sum((self.part.to_code(x) & mask) << k for x, k in zip(value, places, strict=False))

    def to_value(self, code: int) -> Sequence[float]:
        """Return the components of such codes; of a unit vector all are known or none."""
        mask = (1 << self.part.n_bits) - 1
        parts = [self.part.to_value(code >> k & mask) for k in range(0, self.n_bits, self.part.n_bits)]
        if len(parts) == 2:
            x, y = parts
            if math.isnan(x + y):
                return math.nan, math.nan, math.nan
            parts.append(math.sqrt(max(1.0 - x * x - y * y, 0.0)))
        return tuple(parts)


@dataclass(frozen=True)
class Age(CanSignal[int | None]):
    """A time since something [ns], rounded up; the largest code is no value: None, negative, or above the range.

    Attributes:
        step_ns: What a bit stands for [ns].
        nearest: Whether it is rounded to the nearest, and not up.
        saturates: Whether an age above the range is sent as the largest.
    """

    step_ns: int
    nearest: bool = False
    saturates: bool = False

    def to_code(self, value: int | None) -> int:
        """Return the code of an age [ns]."""
        none = (1 << self.n_bits) - 1
        if value is None or value < 0:
            return none
        code = round(value / self.step_ns) if self.nearest else -(-value // self.step_ns)
        return min(code, none - 1 if self.saturates else none)

    def to_value(self, code: int) -> int | None:
        """Return the age of a code [ns]."""
        return None if code == (1 << self.n_bits) - 1 else code * self.step_ns


class Layout:
    """The signals of a named tuple, as the annotations of its fields tell them.

    Args:
        content: The named tuple; fields without a signal are left out.

    Attributes:
        signals: Signal of each of the other fields, by name.
    """

    def __init__(self, content: Callable[..., Any]) -> None:
        hints = {name: get_args(hint) for name, hint in get_type_hints(content, include_extras=True).items()}
        kinds = {name: args for name, args in hints.items() if args and isinstance(args[-1], CanSignal)}
        self.signals: dict[str, CanSignal[Any]] = {name: signal for name, (_, signal) in kinds.items()}
        places = [
            (kind, signal, signal.first_bit, (1 << signal.n_bits) - 1) for kind, signal in kinds.values()
        ]
        self._packed = [
            (int if isinstance(signal, Code) else signal.to_code, *place) for _, signal, *place in places
        ]
        self._unpacked = [(_converter(kind, signal), *place) for kind, signal, *place in places]
        self.n_bits = max(signal.end_bit for signal in self.signals.values())

    def pack(self, values: Iterable[Any]) -> int:
        """Return the bits of a value for each signal."""
        bits = 0
        for value, (to_code, first_bit, mask) in zip(values, self._packed, strict=True):
            bits |= (to_code(value) & mask) << first_bit
        return bits

    def unpack(self, bits: int) -> list[Any]:
        """Return the value of each signal.

        Raises:
            FrameError: A code stands for no member of its enumeration.
        """
        return [to_value(bits >> first_bit & mask) for to_value, first_bit, mask in self._unpacked]


class Codec(Generic[Content]):
    """Encoder and decoder of a protected frame with at most 8 data bytes.

    Args:
        can_id: CAN id of its kind, without the node.
        content: Named tuple of node, counter, and a field for each signal.

    Attributes:
        can_id: CAN id of its kind, without the node.
        layout: Its signals.
        length: Number of its data bytes.
    """

    def __init__(self, can_id: int, content: Callable[..., Content]) -> None:
        self.can_id = can_id
        self._content = content
        self.layout = Layout(content)
        self.length = -(-self.layout.n_bits // 8)

    def encode(self, content: Content) -> bytes:
        """Return the data bytes of a frame."""
        node, counter, *values = content
        bits = self.layout.pack(values) >> 8 | counter
        return protect(self.can_id + node, bits.to_bytes(self.length - 1, "little"))

    def pack(self, content: Content) -> bytes:
        """Return a frame as `struct can_frame`."""
        return pack_frame(self.can_id + content[0], self.encode(content))

    def decode(self, can_id: int, data: bytes) -> Content:
        """Return the content of a frame, after checking it.

        Raises:
            FrameError: The id, length, crc or counter is wrong, or a code stands for no member of its enumeration.
        """
        node = node_of(can_id, self.can_id)
        counter = check_frame_and_get_counter(can_id, data, self.length)
        return self._content(node, counter, *self.layout.unpack(int.from_bytes(data, "little")))


def _converter(kind: type, signal: CanSignal[Any]) -> Callable[[int], Any]:
    """Return what makes the value of a field from its code."""
    if not isinstance(signal, Code):
        return signal.to_value
    return partial(_enum_member, kind) if issubclass(kind, IntEnum) else kind


def _enum_member(codes: type[IntEnum], code: int) -> IntEnum:
    try:
        return codes(code)
    except ValueError:
        raise FrameError(f"no {codes.__name__} has the code {code}") from None
