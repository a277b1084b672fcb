"""The DBC of a robot with eight legs as cantools reads it, and what tests draw for its signals."""

import math
from typing import Any

import cantools
from hypothesis import strategies as st

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.crc8 import protect
from firmware_interface.can.dbc import make_dbc

DBC = cantools.database.load_string(make_dbc(list(NODE_IDS)), "dbc")

LEGS = [leg.capitalize() for leg in NODE_IDS]
legs = st.sampled_from(list(NODE_IDS))
counters = st.integers(0, 14)
masks = st.integers(0, 0x1FF)
millinewtons = st.one_of(st.none(), st.integers(-32767, 32767))
offsets = st.one_of(st.none(), st.integers(-32767, 32767))
sigma_codes = st.one_of(st.none(), st.integers(0, 510))


def decode(name: str, data: bytes) -> dict[str, Any]:
    """Return the numbers that cantools reads, with value tables left alone."""
    signals: dict[str, Any] = DBC.decode_message(name, data, decode_choices=False)
    return signals


def encode(name: str, signals: dict[str, Any]) -> bytes:
    """Return what cantools writes, with the crc put in, which a DBC cannot compute."""
    message = DBC.get_message_by_name(name)
    data: bytes = message.encode({"CHECKSUM": 0, **signals}, strict=False)
    return protect(message.frame_id, data[1:])


def number(code: int | None, per_unit: int) -> float:
    """Return the value of a code; NaN for none."""
    return math.nan if code is None else code / per_unit
