"""Every frame: Python, C and the DBC, as cantools reads it, are three accounts of the same bytes."""

import ctypes
import json
import math
from collections.abc import Callable, Iterator
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.can.codes import NODE_IDS, USABLE, Flag, State
from firmware_interface.can.commands import ANSWER, COMMAND
from firmware_interface.can.crc8 import FrameError, protect
from firmware_interface.can.dbc import make_dbc
from firmware_interface.can.force import FORCE, QUALITY
from firmware_interface.can.gait import GAIT_EVENT, GROUND, LEG_MOTION
from firmware_interface.can.reports import (
    BASELINE,
    CALIBRATION,
    FAULT,
    HEARTBEAT_ID,
    IDENTITY,
    decode_heartbeat,
    encode_heartbeat,
)
from firmware_interface.can.signals import Codec
from tests.contract.c_decoder import library
from tests.support.can_frames import encode_force, encode_quality

VECTORS = json.loads((Path(__file__).parents[2] / "firmware_interface/vectors/can_frames.json").read_text())
DBC = cantools.database.load_string(make_dbc(list(NODE_IDS)), "dbc")
COMMANDS, WORDS = (
    DBC.get_message_by_name("CommandLf").get_signal_by_name(s).choices for s in ("Kind", "Word")
)
NO_FORCE = -32768
Numbers = dict[str, Any]


class Field(NamedTuple):
    """A number of a frame, three times.

    Attributes:
        name: Field in Python; "force_n.0" is a part of it, and "flags.CONTACT" one of its flags.
        signal: Signal of the DBC; empty if it has none.
        unit: Of the signal, in that of Python.
        c_type: Type in C; empty if C does not have it. A field without a number is then the largest, or the least.
        per_unit: Of the number in C, in that of Python.
        is_log: Whether the signal is in eighths of an octave over the unit.
    """

    name: str
    signal: str = ""
    unit: float = 1
    c_type: str = "B"
    per_unit: float = 1
    is_log: bool = False

    def in_dbc(self, number: float) -> float:
        """Return the number of a signal in the unit of Python."""
        return math.ceil(1000 * 2 ** (number / 8)) * self.unit / 1000 if self.is_log else number * self.unit

    def of(self, content: Any) -> float:
        """Return the number of a decoded frame; NaN for none."""
        name, *parts = self.name.split(".")
        value = reduce(
            lambda whole, part: whole[int(part)] if part.isdigit() else bool(whole & Flag[part]),
            parts,
            getattr(content, name),
        )
        return math.nan if value is None else float(value)

    def in_c(self, content: Any) -> int:
        """Return it as C says it."""
        value = self.of(content)
        if math.isnan(value):
            n_bits = 8 * ctypes.sizeof(C_TYPES[self.c_type])
            return -(1 << n_bits - 1) if self.c_type.islower() else (1 << n_bits) - 1
        return round(value * self.per_unit)


C_TYPES: dict[str, type[Any]] = {
    "B": ctypes.c_uint8,
    "H": ctypes.c_uint16,
    "h": ctypes.c_int16,
    "i": ctypes.c_int32,
    "I": ctypes.c_uint32,
    "?": ctypes.c_bool,
}


class Frame(NamedTuple):
    """A kind of frame: its id, how Python reads and writes it, and its fields in the order of C."""

    base: int
    decode: Callable[[int, bytes], Any]
    encode: Callable[[Any], bytes]
    fields: tuple[Field, ...]

    def read_in_c(self, name: str, can_id: int, data: bytes) -> list[int] | None:
        """Return the fields that C reads; None if it refuses the frame."""
        named = [(field.name, C_TYPES[field.c_type]) for field in self.fields if field.c_type]
        out = type(name, (ctypes.Structure,), {"_fields_": named})()
        decode = getattr(library(), f"footsense_decode_{name}")
        decode.restype = ctypes.c_bool
        if not decode(ctypes.c_uint32(can_id), data, ctypes.c_uint8(len(data)), ctypes.byref(out)):
            return None
        return [getattr(out, field) for field, _ in named]

    def read_in_python(self, can_id: int, data: bytes) -> list[int] | None:
        """Return the same from Python, as C says it."""
        try:
            content = self.decode(can_id, data)
        except FrameError:
            return None
        return [field.in_c(content) for field in self.fields if field.c_type]


def frame_of(codec: Codec[Any], *fields: Field, encode: Callable[[Any], bytes] | None = None) -> Frame:
    """Return the frame of a codec, with its fields behind node and counter."""
    head = Field("node"), Field("counter", "COUNTER")
    return Frame(codec.can_id, codec.decode, encode or codec.encode, (*head, *fields))


FRAMES = {
    "force": frame_of(
        FORCE,
        Field("state", "State"),
        *(Field(f"force_n.{n}", f"Force{axis}", 1, "i", 1e3) for n, axis in enumerate("XYZ")),
        encode=lambda content: encode_force(*content),
    ),
    "quality": frame_of(
        QUALITY,
        Field("flags"),
        *(Field(f"sigma_n.{n}", f"Sigma{axis}", 1e-3, "I", 1e6, is_log=True) for n, axis in enumerate("XYZ")),
        Field("contact_probability", "ContactProbability", 1, "H", 1e3),
        Field("holds", "Holds", 1, "H", 1e3),
        Field("age_ns", "Age", 1e6, "I", 1e-3),
        *(Field(f"flags.{f.name}", str(f.name).title().replace("_", ""), 1, "") for f in Flag),
        encode=lambda content: encode_quality(*content),
    ),
    "fault": frame_of(
        FAULT,
        Field("state", "State"),
        Field("previous", "PreviousState"),
        Field("cause", "Cause"),
        Field("fault_mask", "FaultMask", 1, "H"),
    ),
    "baseline": frame_of(
        BASELINE,
        Field("status", "Status"),
        Field("mean_pf", "MeanOffset", 1e-3, "i", 1e6),
        Field("worst_pf", "WorstOffset", 1e-3, "i", 1e6),
        Field("age_ns", "Age", 1e9, "I", 1e-6),
    ),
    "identity": frame_of(
        IDENTITY,
        Field("version", "Version"),
        Field("force_step_mn", "ForceStep"),
        Field("foot_type_hash", "FootTypeHash", 1, "I"),
    ),
    "command": frame_of(COMMAND, Field("kind", "Kind"), Field("word", "Word")),
    "answer": Frame(
        *(ANSWER.can_id, ANSWER.decode, ANSWER.encode),
        (
            *(Field("node"), Field("result", "Result"), Field("counter", "COUNTER")),
            *(Field("command_kind", "Kind"), Field("command_counter", "CommandCounter")),
        ),
    ),
    "heartbeat": Frame(
        HEARTBEAT_ID,
        decode_heartbeat,
        lambda content: encode_heartbeat(content.state, degraded_timing=content.degraded_timing),
        (Field("node"), Field("state", "NmtState"), Field("degraded_timing", "DegradedTiming", 1, "?")),
    ),
    "gait_event": frame_of(
        GAIT_EVENT,
        Field("kind", "Kind"),
        Field("all_in_air", "AllInAir", 1, "?"),
        Field("sigma_s", "Sigma", 1e-3, "H", 1e6),
        Field("age_ns", "Age", 1e6, "I", 1e-3),
    ),
    "calibration": frame_of(
        CALIBRATION,
        Field("kind", "Kind"),
        Field("day", "Day", 1, "H"),
        Field("size_error_percent", "SizeError", 1, "H", 10),
        Field("direction_error_deg", "DirectionError", 1, "H", 10),
    ),
    "leg_motion": frame_of(
        LEG_MOTION,
        Field("phase", "Phase"),
        Field("acceleration_m_per_s2", "Acceleration"),
        Field("sigma_m_per_s2", "AccelerationSigma", 1e-2, is_log=True),
        Field("up.0", "UpX"),
        Field("up.1", "UpY"),
    ),
    "ground": frame_of(
        GROUND,
        Field("normal.0", "NormalX", 1, "h", 1e3),
        Field("normal.1", "NormalY", 1, "h", 1e3),
        Field("normal_sigma_rad", "NormalSigma", 1, "I", 1e6),
        Field("tangential_over_normal", "TangentialOverNormal", 1, "H", 1e3),
        Field("tangential_over_normal_sigma", "TangentialOverNormalSigma", 1, "H", 1e3),
        Field("friction", "Friction", 1, "H", 1e3),
    ),
}
#: C writes what the gait controller sends, and reads all others.
SENT_BY_CONTROLLER = {"command", "leg_motion"}
READ_IN_C = sorted(set(FRAMES) - SENT_BY_CONTROLLER)


def dbc_name(kind: str, leg: str = "lf") -> str:
    """Return the name of a leg's frame in the DBC."""
    return (kind + "_" + leg).title().replace("_", "")


@st.composite
def codes(draw: st.DrawFn, kind: str, leg: str) -> dict[str, int]:
    """Return a code for each signal of a frame, such as a service or a controller sends them."""
    drawn = {}
    for signal in DBC.get_message_by_name(dbc_name(kind, leg)).signals:
        named = {str(name): code for code, name in (signal.choices or {}).items()}
        if set(named) - {"NoValue", "Saturated"}:
            drawn[signal.name] = draw(st.sampled_from(list(named.values())))
            continue
        bounds = [round(limit / signal.scale) for limit in (signal.minimum, signal.maximum)]
        drawn[signal.name] = draw(st.integers(*bounds) | st.sampled_from(list(named.values()) or bounds))
    if kind == "force" and drawn["State"] not in USABLE:
        drawn |= dict.fromkeys(("ForceX", "ForceY", "ForceZ"), NO_FORCE)
    if kind == "force" and NO_FORCE in drawn.values():  # a usable one with a hole leaves as a fault
        drawn |= dict.fromkeys(("ForceX", "ForceY", "ForceZ"), NO_FORCE) | {"State": State.STALE}
    if kind == "command":
        drawn["Word"] = {str(word): code for code, word in WORDS.items()}[str(COMMANDS[drawn["Kind"]])]
    normal = [drawn[axis] for axis in ("NormalX", "NormalY") if kind == "ground"]
    if any(abs(code) > 350 for code in normal):  # it would lean further than level, or is none
        drawn |= {"NormalX": -512, "NormalY": -512}
    if kind == "leg_motion" and any(abs(drawn[axis]) > 700 for axis in ("UpX", "UpY")):
        drawn |= {"UpX": -1024, "UpY": -1024}
    return drawn


@pytest.mark.parametrize("kind", FRAMES)
@given(data=st.data())
def test_all_read_what_any_writes(kind: str, data: st.DataObject) -> None:
    """Any numbers, and none where there may be none: the same values of every leg, and the same bytes."""
    frame, leg = FRAMES[kind], data.draw(st.sampled_from(list(NODE_IDS)))
    message = DBC.get_message_by_name(dbc_name(kind, leg))
    theirs = message.encode(data.draw(codes(kind, leg)), scaling=False, strict=False)
    theirs = theirs if kind == "heartbeat" else protect(message.frame_id, theirs[1:])
    said: Numbers = message.decode(theirs, decode_choices=False)
    named = message.decode(theirs)
    assert kind == "heartbeat" or said["CHECKSUM"] == theirs[0]
    ours = frame.decode(message.frame_id, theirs)
    assert (message.frame_id, ours.node) == (frame.base + NODE_IDS[leg], NODE_IDS[leg])
    for field in frame.fields:
        if field.signal:
            is_none = str(named[field.signal]) == "NoValue"
            expected = math.nan if is_none else field.in_dbc(float(said[field.signal]))
            assert field.of(ours) == pytest.approx(expected, nan_ok=True)
    assert frame.encode(ours) == theirs
    if kind in READ_IN_C:
        in_c = frame.read_in_c(kind, message.frame_id, theirs)
        assert in_c == frame.read_in_python(message.frame_id, theirs) is not None


@given(
    st.sampled_from(READ_IN_C),
    st.integers(0, 9),
    st.binary(min_size=8, max_size=8),
    st.sampled_from(["long", "wrong", *["whole"] * 6]),
)
def test_c_and_python_read_and_refuse_the_same(kind: str, node: int, payload: bytes, harm: str) -> None:
    """Any contents, with one byte too many or one bit wrong now and then."""
    frame = FRAMES[kind]
    length = DBC.get_message_by_name(dbc_name(kind)).length
    data = (payload + payload)[: length + (harm == "long")]
    if length > 1:
        data = protect(frame.base + node, data[1:])
    if harm == "wrong":
        data = bytes([data[0] ^ 1]) + data[1:]
    assert frame.read_in_c(kind, frame.base + node, data) == frame.read_in_python(frame.base + node, data)


def flat(values: Any) -> Iterator[float]:
    """Yield all numbers of a vector or of a frame; NaN for none."""
    for value in values:
        if isinstance(value, list | tuple):
            yield from flat(value)
        else:
            yield math.nan if value is None else value


@pytest.mark.parametrize("kind", sorted(set(FRAMES) - {"heartbeat"}))
def test_the_vectors_hold(kind: str) -> None:
    """Of every frame the numbers and the bytes: Python reads and writes them, and C reads the same."""
    frame = FRAMES[kind]
    for vector in VECTORS[kind]:
        data = bytes.fromhex(vector.pop("data"))
        expected = list(flat(vector.values()))
        can_id = frame.base + int(expected[0])
        content = frame.decode(can_id, data)
        part = {"ground": "normal", "leg_motion": "up"}.get(kind)
        shown = content._replace(**{part: getattr(content, part)[:2]}) if part else content
        assert list(flat(shown))[: len(expected)] == pytest.approx(expected, nan_ok=True)
        assert frame.encode(content) == data
        assert kind in SENT_BY_CONTROLLER or frame.read_in_c(kind, can_id, data) == frame.read_in_python(
            can_id, data
        )


@pytest.mark.parametrize("vector", VECTORS["refused"] + VECTORS["refused_events"], ids=lambda v: v["why"])
def test_frames_that_must_not_be_used_are_refused(vector: dict[str, Any]) -> None:
    """By both; among them the first code beyond the highest of each kind, under a right crc."""
    kind, can_id, data = vector.get("kind", "force"), vector["can_id"], bytes.fromhex(vector["data"])
    assert FRAMES[kind].read_in_c(kind, can_id, data) is None
    assert FRAMES[kind].read_in_python(can_id, data) is None


def test_codes_for_no_value_are_named() -> None:
    """A tool that shows value tables shows `NoValue`, not a number."""
    force = DBC.decode_message("ForceLf", encode_force(1, 0, State.STALE, (1.0, 1.0, 1.0)))
    assert [str(force[f"Force{axis}"]) for axis in "XYZ"] == ["NoValue"] * 3
    quality = DBC.decode_message(
        "QualityLf", encode_quality(1, 0, 0, None, (math.nan, 56.0, math.nan), math.nan)
    )
    assert [str(quality[s]) for s in ("Age", "SigmaX", "SigmaY")] == ["NoValue", "NoValue", "Saturated"]
    assert str(quality["ContactProbability"]) == "NoValue"
