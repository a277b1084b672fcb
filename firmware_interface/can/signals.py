"""Signals of the CAN frames: how a value becomes bits, and the codec of a frame from the table of its signals.

The content of a frame is a named tuple: node, counter, and a field for each signal, annotated with its place in the
frame. That table is all that `Codec` needs: each signal makes the function for its code once. Bits that no signal has
are 0. Bit 0 is the least significant of byte 0.
"No value" has a code of its own, apart from that of a number too large for its field, so that neither passes for a
measurement.

Units:
    Ages ns; numbers in those of the field.
"""

import math
import struct
from abc import abstractmethod
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property, partial
from operator import call
from typing import Any, Generic, TypeVar, get_args, get_type_hints

from firmware_interface.can.crc8 import ID_CRC, FrameError, check_frame_and_get_counter, crc8, node_of

#: Rounds up, except for the rounding error of a whole number of bits.
_CEILING_OFFSET = 1 - 1e-6

#: A `struct can_frame`, with the crc apart from the payload.
_FRAME = struct.Struct("<IB3xB7s")

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

    @cached_property
    def mask(self) -> int:
        """Its largest code: all bits set."""
        return (1 << self.n_bits) - 1

    @abstractmethod
    def encoder(self) -> Callable[[Value], int]:
        """Return the function that makes the code of a value, at its place in the frame."""

    @abstractmethod
    def to_value(self, code: int) -> Value:
        """Return the value of a code."""


@dataclass(frozen=True)
class Code(CanSignal[int]):
    """An integer, a truth value, or a member of an enumeration; bits beyond the field are left out."""

    def encoder(self) -> Callable[[int], int]:
        """Return the function that puts a value to its place."""
        mask, first_bit = self.mask, self.first_bit
        return lambda value: (value & mask) << first_bit

    def to_value(self, code: int) -> int:
        """Return the code itself."""
        return code


@dataclass(frozen=True)
class Number(CanSignal[float]):
    """A number without sign, limited to its range.

    The largest code is no value, which NaN and a negative number have, and the one before it the largest number.

    Attributes:
        per_unit: Codes per unit.
        up: Whether it is rounded up, as a standard deviation must never look smaller than it is.
    """

    per_unit: int
    up: bool = False

    def encoder(self) -> Callable[[float], int]:
        """Return the function that makes the code of a number, at its place."""
        none, most, per_unit = self.mask, float(self.mask - 1), float(self.per_unit)
        offset, first_bit = _CEILING_OFFSET if self.up else 0.5, self.first_bit

        def to_code(value: float) -> int:
            code = value * per_unit
            if 0.0 <= code < most:
                return int(code + offset) << first_bit
            return none - (code > 0.0) << first_bit

        return to_code

    def to_value(self, code: int) -> float:
        """Return the number of a code."""
        return math.nan if code == self.mask else code / self.per_unit


@dataclass(frozen=True)
class LogNumber(CanSignal[float]):
    """A positive number in steps of an eighth of an octave, 9 %, rounded up, as a standard deviation must be.

    Code c is 2^(c/8) times the number of code 0, rounded up to a thousandth of that. The largest code is no value,
    which NaN and a negative number have, and the one before it that number or more.

    Attributes:
        per_unit: Numbers of code 0 in a unit.
    """

    per_unit: int

    @cached_property
    def values(self) -> tuple[float, ...]:
        """The number of each code but the largest."""
        return tuple(math.ceil(1000 * 2 ** (code / 8)) / (1000 * self.per_unit) for code in range(self.mask))

    def encoder(self) -> Callable[[float], int]:
        """Return the function that makes the code of a number, at its place."""
        smaller, none, first_bit = self.values[:-1], self.mask << self.first_bit, self.first_bit
        return lambda value: bisect_left(smaller, value) << first_bit if value >= 0.0 else none

    def to_value(self, code: int) -> float:
        """Return the number of a code."""
        return math.nan if code == self.mask else self.values[code]


@dataclass(frozen=True)
class SignedNumber(CanSignal[float]):
    """A number with sign, rounded, and limited to its range, which is symmetric; the least code is no value, as of NaN.

    Attributes:
        per_unit: Codes per unit.
    """

    per_unit: int

    def encoder(self) -> Callable[[float], int]:
        """Return the function that makes the code of a number, at its place."""
        mask, most, per_unit = self.mask, float(self.mask >> 1), float(self.per_unit)
        first_bit = self.first_bit

        def to_code(value: float) -> int:
            code = value * per_unit
            if -most <= code <= most:
                return (round(code) & mask) << first_bit
            return (int(-most - 1 if math.isnan(code) else math.copysign(most, code)) & mask) << first_bit

        return to_code

    def to_value(self, code: int) -> float:
        """Return the number of a code."""
        none = (self.mask >> 1) + 1
        return math.nan if code == none else ((code ^ none) - none) / self.per_unit


@dataclass(frozen=True)
class Vector(CanSignal[Sequence[float]]):
    """A vector of three numbers one behind the other; the third of a unit vector may be left out.

    Attributes:
        part: One of the numbers.
    """

    part: Number | LogNumber | SignedNumber

    def encoder(self) -> Callable[[Sequence[float]], int]:
        """Return the function that makes the codes of the components, at their places."""
        places = range(self.first_bit, self.first_bit + 3 * self.part.n_bits, self.part.n_bits)
        x_to_code, y_to_code, z_to_code = (replace(self.part, first_bit=bit).encoder() for bit in places)

        def to_code(value: Sequence[float]) -> int:
            x, y, z = value
            return x_to_code(x) | y_to_code(y) | z_to_code(z)

        def without_z(value: Sequence[float]) -> int:
            return x_to_code(value[0]) | y_to_code(value[1])

        return to_code if self.n_bits > 2 * self.part.n_bits else without_z

    def to_value(self, code: int) -> Sequence[float]:
        """Return the components of such codes; of a unit vector all are known or none."""
        part = self.part
        parts = [part.to_value(code >> k & part.mask) for k in range(0, self.n_bits, part.n_bits)]
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

    def encoder(self) -> Callable[[int | None], int]:
        """Return the function that makes the code of an age [ns], at its place."""
        none, most = self.mask << self.first_bit, self.mask - self.saturates
        step_ns, nearest, first_bit = self.step_ns, self.nearest, self.first_bit

        def to_code(value: int | None) -> int:
            if value is None or value < 0:
                return none
            code = round(value / step_ns) if nearest else -(-value // step_ns)
            return (code if code < most else most) << first_bit

        return to_code

    def to_value(self, code: int) -> int | None:
        """Return the age of a code [ns]."""
        return None if code == self.mask else code * self.step_ns


class Codec(Generic[Content]):
    """Encoder and decoder of a protected frame with at most 8 data bytes.

    Args:
        can_id: CAN id of its kind, without the node.
        content: Named tuple of node, counter, and a field for each signal, in the order of the fields.

    Attributes:
        can_id: CAN id of its kind, without the node.
        signals: Its signals, by the names of their fields.
        length: Number of its data bytes.
    """

    def __init__(self, can_id: int, content: Callable[..., Content]) -> None:
        self.can_id = can_id
        self._content = content
        hints = {name: get_args(hint) for name, hint in get_type_hints(content, include_extras=True).items()}
        kinds = {name: args for name, args in hints.items() if args and isinstance(args[-1], CanSignal)}
        self.signals: dict[str, CanSignal[Any]] = {name: signal for name, (_, signal) in kinds.items()}
        self._encoders = [signal.encoder() for signal in self.signals.values()]
        self._decoders = [
            (_converter(kind, signal), signal.first_bit, signal.mask) for kind, signal in kinds.values()
        ]
        self.length = -(-max(signal.first_bit + signal.n_bits for signal in self.signals.values()) // 8)

    def encode(self, content: tuple[Any, ...]) -> bytes:
        """Return the data bytes of a frame; a plain tuple of the same values will do."""
        return self.pack(content)[8 : 8 + self.length]

    def pack(self, content: tuple[Any, ...]) -> bytes:
        """Return a frame as `struct can_frame`; `content` as of `encode`."""
        can_id, length = self.can_id + content[0], self.length
        bits = sum(map(call, self._encoders, content[2:]), content[1] << 8)  # no two signals share a bit
        payload = (bits >> 8).to_bytes(length - 1, "little")
        return _FRAME.pack(can_id, length, crc8(payload, ID_CRC[can_id]), payload)

    def decode(self, can_id: int, data: bytes) -> Content:
        """Return the content of a frame, after checking it.

        Raises:
            FrameError: The id, length, crc or counter is wrong, or a code stands for no member of its enumeration.
        """
        node = node_of(can_id, self.can_id)
        counter = check_frame_and_get_counter(can_id, data, self.length)
        bits = int.from_bytes(data, "little")
        values = [to_value(bits >> first_bit & mask) for to_value, first_bit, mask in self._decoders]
        return self._content(node, counter, *values)


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
