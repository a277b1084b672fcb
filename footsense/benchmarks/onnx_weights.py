"""The numbers inside an ONNX file, read without a library that knows the format: the robot has none.

ONNX is protobuf: fields as (number, wire type), varints, and byte strings with their length. Of it this reads what the
released network consists of: graph -> initializers -> name, shape, type, raw data.

Source:
    https://protobuf.dev/programming-guides/encoding, and onnx.proto: ModelProto.graph 7, GraphProto.initializer 5,
    TensorProto.dims 1, .data_type 2, .name 8, .raw_data 9; data type 1 is float32, 7 is int64.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["initializers"]

_TYPES: dict[int, np.dtype[Any]] = {1: np.dtype("<f4"), 7: np.dtype("<i8")}


def initializers(model: bytes) -> dict[str, NDArray[Any]]:
    """Return every constant of a network's graph by name, in its shape."""
    found = {}
    for graph in _values(model, 7):
        for tensor in _values(graph, 5):
            shape = [size for packed in _values(tensor, 1) for size in _sizes(packed)]
            (kind,), (name,), (data,) = (list(_values(tensor, number)) for number in (2, 8, 9))
            found[bytes(name).decode()] = np.frombuffer(data, _TYPES[int(kind)]).reshape(shape)
    return found


def _sizes(packed: bytes | int) -> list[int]:
    """Return the sizes of a shape, written together or one by one."""
    if isinstance(packed, int):
        return [packed]
    sizes, at = [], 0
    while at < len(packed):
        size, at = _varint(packed, at)
        sizes.append(size)
    return sizes


def _values(message: Any, wanted: int) -> Iterator[Any]:  # noqa: ANN401 - a number or bytes, as the field's kind has it
    """Walk through a message.

    Yields:
        Each value of the field with this number.
    """
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        value: Any
        match key & 7:
            case 0:
                value, at = _varint(message, at)
            case 2:
                length, at = _varint(message, at)
                value, at = message[at : at + length], at + length
            case kind:
                width = 8 if kind == 1 else 4
                value, at = message[at : at + width], at + width
        if key >> 3 == wanted:
            yield value


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """Return a number in groups of seven bits, lowest first, and where it ends."""
    value = shift = 0
    while True:
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
