"""Encoder of ROS 2 messages as CDR bytes, little-endian.

Every number stands at a multiple of its size, counted from behind the four bytes of the header. A string is its length
with the ending 0, then its bytes; a list is its length, then its entries.

Source:
    OMG, DDS Interoperability Wire Protocol 2.5 (formal/22-04-01), 10.2: plain CDR version 1.
"""

import struct
from collections.abc import Callable
from functools import cache
from operator import attrgetter
from typing import Any

from footsense.ros2.definitions import fields_of
from footsense.ros2.messages import Message

_CDR_HEADER = b"\x00\x01\x00\x00"
_STRUCT_FORMATS = {"byte": "B", "uint8": "B", "int32": "i", "uint32": "I", "float64": "d"}

_ValueWriter = Callable[[bytearray, Any], None]


def encode(message: Message) -> bytes:
    """Return a ROS 2 message as CDR bytes that begin with the encapsulation header of 4 bytes."""
    out, kind = bytearray(), _message_class(message)
    _value_writer(kind)(out, message)
    return _CDR_HEADER + out


def _message_class(message: Message) -> type:
    return type(message)


@cache
def _value_writer(kind: type | str) -> _ValueWriter:
    """Return the function that appends values of a type to CDR bytes."""
    if kind == "string":
        return _write_string
    if isinstance(kind, str):
        return _number_writer(struct.Struct(f"<{_STRUCT_FORMATS[kind]}"))
    parts = [
        (
            attrgetter(field.name),
            _list_writer(field.value_type) if field.is_list else _value_writer(field.value_type),
        )
        for field in fields_of(kind)
    ]

    def write(out: bytearray, message: object) -> None:
        for get, write_part in parts:
            write_part(out, get(message))

    return write


def _number_writer(form: struct.Struct) -> _ValueWriter:
    def write(out: bytearray, value: float) -> None:
        out.extend(bytes(-len(out) % form.size) + form.pack(value))

    return write


_write_length = _number_writer(struct.Struct("<I"))


def _write_string(out: bytearray, value: str) -> None:
    data = value.encode() + b"\0"
    _write_length(out, len(data))
    out.extend(data)


def _list_writer(kind: type | str) -> _ValueWriter:
    write_entry = _value_writer(kind)

    def write(out: bytearray, values: list[object]) -> None:
        _write_length(out, len(values))
        for value in values:
            write_entry(out, value)

    return write
