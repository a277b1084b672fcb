"""WebSocket messages between server and page: JSON as text, cycles as binary.

server -> page   hello, status, events, progress    JSON objects with `type`
                 cycles                             binary, see `encode_cycles`
page -> server   drawn, chunk                       JSON objects with `type`
"""

import struct
from collections.abc import Sequence
from typing import Any, Literal

import msgspec
import numpy as np

from footsense import __version__
from footsense.view.events import Event
from footsense.view.signals import SIGNALS, Table
from footsense.view.words import code_texts

_CYCLES_HEADER_STRUCT = struct.Struct("<IIII")


class DrawnAcknowledgement(msgspec.Struct, tag="drawn", tag_field="type", forbid_unknown_fields=True):
    """Message from the page: a message of cycles has been drawn, the next may be sent."""


class ChunkRequest(msgspec.Struct, tag="chunk", tag_field="type", forbid_unknown_fields=True):
    """Message from the page: request for one second of a recording, by number."""

    number: int


Request = DrawnAcknowledgement | ChunkRequest
_decoder: msgspec.json.Decoder[Request] = msgspec.json.Decoder(Request)


def decode_request(message: str | bytes) -> Request:
    """Return a message of the page decoded to its type.

    Raises:
        ValueError: It is none of this protocol.
    """
    if isinstance(message, bytes):
        raise ValueError("a binary message, and only text is meant")  # noqa: TRY004 - one error for all rubbish
    return _decoder.decode(message)


def hello_message(
    mode: Literal["live", "replay"],
    title: str,
    legs: Sequence[str],
    *,
    simulated: bool,
) -> str:
    """Return the first message to a page: mode, title, legs, signals, and texts of the codes.

    Args:
        mode: Whether a service or a recording is shown.
        title: Its name.
        legs: Names of its legs.
        simulated: Whether its feet are simulated.
    """
    values = {
        "version": __version__,
        "mode": mode,
        "title": title,
        "legs": list(legs),
        "simulated": simulated,
        "signals": [signal._asdict() for signal in SIGNALS],
        "words": code_texts(),
    }
    return message("hello", values)


def events_message(events: Sequence[tuple[float, Event]], legs: Sequence[str]) -> str:
    """Return a JSON message of events with their times [s]."""
    return message(
        "events",
        {
            "events": [
                {
                    "t": t_s,
                    "leg": None if event.leg is None else legs[event.leg],
                    "kind": event.kind,
                    "level": event.severity,
                    "text": event.text,
                }
                for t_s, event in events
            ]
        },
    )


def message(kind: str, values: dict[str, Any]) -> str:
    """Return a JSON message of the given kind."""
    return msgspec.json.encode({"type": kind, **values}).decode()


def encode_cycles(kind: int, times_s: Sequence[float], tables: Sequence[Table]) -> bytes:
    """Return several cycles as one binary message: header, times, tables.

    Four little-endian u32: `kind`, cycles, legs, signals; then the time of each cycle as float64; then the tables as
    float32.

    Args:
        kind: 0 for live cycles; 1 + number for a second of a recording.
        times_s: Time of each cycle [s].
        tables: Signals of each, shape (legs, signals).
    """
    n_legs, n_signals = tables[0].shape if tables else (0, 0)
    head = _CYCLES_HEADER_STRUCT.pack(kind, len(tables), n_legs, n_signals)
    return b"".join((head, np.array(times_s, "<f8").tobytes(), *(t.astype("<f4").tobytes() for t in tables)))
