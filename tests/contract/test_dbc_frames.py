"""Every frame: the DBC, as cantools reads it, and the Python codecs are two accounts of the same bytes."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.can.all_legs import (
    FORCES4_ID,
    FORCES_ID,
    NODES_OF_FRAME,
    decode_forces,
    encode_forces,
)
from firmware_interface.can.codes import NODE_IDS, USABLE, Flag, State
from firmware_interface.can.commands import ANSWER, COMMAND
from firmware_interface.can.crc8 import protect
from firmware_interface.can.dbc import make_dbc
from firmware_interface.can.force import FORCE, QUALITY
from firmware_interface.can.gait import GAIT, GAIT_EVENT, GROUND
from firmware_interface.can.reports import (
    BASELINE,
    FAULT,
    decode_heartbeat,
    encode_heartbeat,
)
from tests.support.can_frames import encode_force, encode_quality

DBC = cantools.database.load_string(make_dbc(list(NODE_IDS)), "dbc")
COMMANDS, WORDS = (
    DBC.get_message_by_name("CommandLf").get_signal_by_name(s).choices for s in ("Kind", "Word")
)
NO_FORCE = -32768
Numbers = dict[str, Any]


class Kind(NamedTuple):
    """How Python reads and writes a kind of frame, and what its fields behind the node are, from the DBC's numbers.

    A number that is `NoValue` is NaN.
    """

    decode: Callable[[int, bytes], Any]
    encode: Callable[[Any], bytes]
    fields: Callable[[Numbers], tuple[Any, ...]]


def none_or_ns(value: float, per_unit: float) -> int | None:
    return None if math.isnan(value) else round(value * per_unit)


def flags(said: Numbers) -> int:
    return sum(flag for flag in Flag if said[str(flag.name).title().replace("_", "")])


def unit(said: Numbers) -> tuple[float, float, float]:
    x, y = said["NormalX"], said["NormalY"]
    return x, y, math.sqrt(1.0 - x * x - y * y)


KINDS = {
    "Force": Kind(
        FORCE.decode,
        lambda content: encode_force(*content),
        lambda n: (n["COUNTER"], n["State"], (n["ForceX"], n["ForceY"], n["ForceZ"])),
    ),
    "Quality": Kind(
        QUALITY.decode,
        lambda content: encode_quality(*content),
        lambda n: (
            *(n["COUNTER"], flags(n), none_or_ns(n["Age"], 1e6), n["FaultMask"]),
            (n["SigmaX"], n["SigmaY"], n["SigmaZ"]),
        ),
    ),
    "Fault": Kind(
        FAULT.decode,
        FAULT.encode,
        lambda n: tuple(n[s] for s in ("COUNTER", "State", "PreviousState", "FaultMask", "Cause")),
    ),
    "Baseline": Kind(
        BASELINE.decode,
        BASELINE.encode,
        lambda n: (
            *(n["COUNTER"], n["Status"], n["MeanOffset"] / 1000, n["WorstOffset"] / 1000),
            none_or_ns(n["Age"], 1e9),
        ),
    ),
    "Command": Kind(COMMAND.decode, COMMAND.encode, lambda n: (n["COUNTER"], n["Kind"], n["Word"])),
    "Answer": Kind(
        ANSWER.decode,
        ANSWER.encode,
        lambda n: tuple(n[s] for s in ("COUNTER", "Result", "Kind", "CommandCounter")),
    ),
    "Heartbeat": Kind(
        decode_heartbeat,
        lambda content: encode_heartbeat(content.state, degraded_timing=content.degraded_timing),
        lambda n: (n["NmtState"], n["DegradedTiming"]),
    ),
    "GaitEvent": Kind(
        GAIT_EVENT.decode,
        GAIT_EVENT.encode,
        lambda n: (n["COUNTER"], n["Kind"], none_or_ns(n["Age"], 1e6), n["Sigma"] / 1000, n["AllInAir"]),
    ),
    "Gait": Kind(
        GAIT.decode,
        GAIT.encode,
        lambda n: tuple(
            n[s] for s in ("COUNTER", "Contact", "ContactRaw", "AllInAir", "Slip", "Probability", "LoadShare")
        ),
    ),
    "Ground": Kind(
        GROUND.decode,
        GROUND.encode,
        lambda n: (
            *(n["COUNTER"], unit(n), n["NormalSigma"]),
            *(n["TangentialOverNormal"], n["TangentialOverNormalSigma"], n["Friction"]),
        ),
    ),
}


@st.composite
def codes(draw: st.DrawFn, kind: str, leg: str) -> dict[str, int]:
    """Return a code for each signal of a frame, such as a service or a controller sends them."""
    drawn = {}
    for signal in DBC.get_message_by_name(kind + leg).signals:
        named = {str(name): code for code, name in (signal.choices or {}).items()}
        if set(named) - {"NoValue", "Saturated"}:
            drawn[signal.name] = draw(st.sampled_from(list(named.values())))
            continue
        bounds = [round(limit / signal.scale) for limit in (signal.minimum, signal.maximum)]
        drawn[signal.name] = draw(st.integers(*bounds) | st.sampled_from(list(named.values()) or bounds))
    if kind == "Force" and drawn["State"] not in USABLE:
        drawn |= dict.fromkeys(("ForceX", "ForceY", "ForceZ"), NO_FORCE)
    if kind == "Force" and NO_FORCE in drawn.values():  # a usable one with a hole leaves as a fault
        drawn |= dict.fromkeys(("ForceX", "ForceY", "ForceZ"), NO_FORCE) | {"State": State.STALE}
    if kind == "Command":
        drawn["Word"] = {str(word): code for code, word in WORDS.items()}[str(COMMANDS[drawn["Kind"]])]
    normal = [drawn[axis] for axis in ("NormalX", "NormalY") if kind == "Ground"]
    if any(abs(code) > 350 for code in normal):  # it would lean further than level, or is none
        drawn |= {"NormalX": -512, "NormalY": -512}
    return drawn


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_each_reads_what_the_other_writes(kind: str, data: st.DataObject) -> None:
    """Any numbers, and none where there may be none: the same values of every leg, and the same bytes."""
    decode, encode, fields = KINDS[kind]
    leg = data.draw(st.sampled_from(list(NODE_IDS)))
    message = DBC.get_message_by_name(kind + leg.capitalize())
    theirs = message.encode(data.draw(codes(kind, leg.capitalize())), scaling=False, strict=False)
    theirs = theirs if kind == "Heartbeat" else protect(message.frame_id, theirs[1:])
    said: Numbers = message.decode(theirs, decode_choices=False)
    named = message.decode(theirs)
    said = {name: math.nan if str(named[name]) == "NoValue" else value for name, value in said.items()}
    assert kind == "Heartbeat" or said["CHECKSUM"] == theirs[0]
    ours = decode(message.frame_id, theirs)
    for read, expected in zip(ours, (NODE_IDS[leg], *fields(said)), strict=True):
        assert read == pytest.approx(expected, nan_ok=True)
    assert encode(ours) == theirs


def test_codes_for_no_value_are_named() -> None:
    """A tool that shows value tables shows `NoValue`, not a number."""
    force = DBC.decode_message("ForceLf", encode_force(1, 0, State.STALE, (1.0, 1.0, 1.0)))
    assert [str(force[f"Force{axis}"]) for axis in "XYZ"] == ["NoValue"] * 3
    quality = DBC.decode_message("QualityLf", encode_quality(1, 0, 0, None, 0, (math.nan, 2.0, math.nan)))
    assert [str(quality[s]) for s in ("Age", "SigmaX", "SigmaY")] == ["NoValue", "NoValue", "Saturated"]


@st.composite
def robots(draw: st.DrawFn) -> tuple[list[int], list[Any]]:
    """Return the nodes of some legs, and for each state, force, sigma, flags and mask."""
    nodes = draw(st.lists(st.integers(1, 8), min_size=1, max_size=8, unique=True))
    common = draw(st.sampled_from([0, 1, 2, 3]))
    parts = [
        (
            draw(st.sampled_from(State)),
            tuple(draw(st.integers(-32767, 32767)) / 1000 for _ in range(3)),
            tuple(draw(st.integers(0, 254)) / 250 for _ in range(3)),
            draw(st.sampled_from([0, 4, 8, 12])) | common,
            draw(st.integers(0, 511)),
        )
        for _ in nodes
    ]
    return nodes, parts


@given(st.sampled_from([FORCES_ID, FORCES4_ID]), robots(), st.integers(0, 14), st.integers(0, 254))
def test_forces_of_all_legs(can_id: int, robot: tuple[list[int], list[Any]], counter: int, age: int) -> None:
    """cantools, Python and the single frames agree on what one CAN FD frame says of every leg."""
    nodes, parts = robot
    state, force_n, sigma_n, flags, mask = zip(*parts, strict=True)
    t_ns, t_sent_ns = [1] * len(nodes), 1 + age * 500_000
    data = encode_forces(can_id, counter, t_sent_ns, nodes, t_ns, state, force_n, sigma_n, flags, mask)
    name = "Forces" if can_id == FORCES_ID else "Forces4"
    signals: Numbers = DBC.decode_message(name, data, decode_choices=False)
    ours = decode_forces(can_id, data)
    assert (signals["CHECKSUM"], signals["COUNTER"]) == (int.from_bytes(data[:2], "little"), counter)
    assert signals["AllInAir"] == ours.all_in_air
    usable = [code in USABLE for code in state]
    assert ours.all_in_air == (all(usable) and not any(flag & Flag.CONTACT for flag in flags))
    shown = [code for node, code in zip(nodes, usable, strict=True) if node in NODES_OF_FRAME[can_id]]
    assert signals["Age"] == (age / 2 if any(shown) else 127.5)
    of_frame = [list(NODE_IDS)[node - 1].capitalize() for node in NODES_OF_FRAME[can_id]]
    for leg, (force, quality) in zip(of_frame, ours.legs, strict=True):
        read = [signals[f"Force{axis}{leg}"] for axis in "XYZ"]
        assert read == pytest.approx([-32.768 if math.isnan(f) else f for f in force.force_n])
        assert (signals[f"State{leg}"], signals[f"FaultMask{leg}"]) == (force.state, quality.fault_mask)
        assert signals[f"Contact{leg}"] == bool(quality.flags & Flag.CONTACT)
        assert signals[f"TareRefused{leg}"] == bool(quality.flags & Flag.TARE_REFUSED)
        sigmas = [signals[f"SigmaXY{leg}"]] * 2 + [signals[f"SigmaZ{leg}"]]
        assert sigmas == pytest.approx([1.02 if math.isnan(s) else s for s in quality.sigma_n])
        if NODE_IDS[leg.lower()] not in nodes:
            assert (force.state, quality.fault_mask, quality.age_ns) == (State.ABSENT, 0, None)
            continue
        row = nodes.index(NODE_IDS[leg.lower()])
        assert (force.counter, force.state, quality.flags) == (counter, state[row], flags[row])
        assert quality.fault_mask == mask[row]
        x_n, y_n, z_n = sigma_n[row]
        assert quality.sigma_n == pytest.approx((max(x_n, y_n), max(x_n, y_n), z_n))
        if usable[row]:
            assert (force.force_n, quality.age_ns) == (force_n[row], age * 500_000)
        else:
            assert all(map(math.isnan, force.force_n))
            assert quality.age_ns is None
    message = DBC.get_message_by_name(name)
    assert message.encode(signals, strict=False) == data
