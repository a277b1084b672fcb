"""The DBC of a robot with eight legs, read by cantools, and the Python codecs are two accounts of the same frames."""

import math
from enum import IntEnum, IntFlag
from typing import Any

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
from firmware_interface.can.baseline import BASELINE_ID, decode_baseline, encode_baseline
from firmware_interface.can.codes import (
    NODE_IDS,
    USABLE,
    BaselineStatus,
    Cause,
    CommandKind,
    Flag,
    GaitEventKind,
    NmtState,
    Result,
    Slip,
    State,
)
from firmware_interface.can.commands import (
    ANSWER_ID,
    COMMAND_ID,
    COMMAND_WORDS,
    UNSOLICITED_COUNTER,
    decode_answer,
    decode_command,
    encode_answer,
    encode_command,
)
from firmware_interface.can.crc8 import protect
from firmware_interface.can.dbc import HEXAPOD_DBC, make_dbc
from firmware_interface.can.events import FAULT_ID, HEARTBEAT_ID, decode_fault, encode_fault, encode_heartbeat
from firmware_interface.can.force import (
    FORCE_ID,
    QUALITY_ID,
    decode_force,
    decode_quality,
)
from firmware_interface.can.gait import (
    GAIT_EVENT_ID,
    GAIT_ID,
    GROUND_ID,
    decode_gait,
    decode_gait_event,
    decode_ground,
    encode_gait,
    encode_gait_event,
    encode_ground,
)
from tests.support.can_frames import encode_force, encode_quality

DBC = cantools.database.load_string(make_dbc(list(NODE_IDS)), "dbc")
SENDERS = {
    "Force": (FORCE_ID, 8, "Footsense"),
    "Quality": (QUALITY_ID, 8, "Footsense"),
    "Baseline": (BASELINE_ID, 8, "Footsense"),
    "Fault": (FAULT_ID, 6, "Footsense"),
    "GaitEvent": (GAIT_EVENT_ID, 6, "Footsense"),
    "Gait": (GAIT_ID, 5, "Footsense"),
    "Ground": (GROUND_ID, 8, "Footsense"),
    "Command": (COMMAND_ID, 8, "GaitController"),
    "Answer": (ANSWER_ID, 4, "Footsense"),
    "Heartbeat": (HEARTBEAT_ID, 1, "Footsense"),
}
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


def camel(names: type[IntEnum] | type[IntFlag]) -> dict[int, str]:
    """Return an enumeration as a value table of the DBC."""
    return {member.value: str(member.name).title().replace("_", "") for member in names}


def test_the_dbc_of_a_hexapod_is_the_committed_one() -> None:
    """Byte for byte; others have the frames of their legs, and forces in their own unit."""
    assert make_dbc(["lf", "lm", "lr", "rf", "rm", "rr"]) == HEXAPOD_DBC.read_text("utf-8")
    trotting = make_dbc(["lf", "lr", "rf", "rr"], force_step_mn=5)
    assert '"footsense: the contact force of every foot of a four-legged robot' in trotting
    four = cantools.database.load_string(trotting, "dbc")
    assert {m.name[-2:] for m in four.messages} == {"Lf", "Lr", "Rf", "Rr", "es"}
    force_z = four.get_message_by_name("ForceRr").get_signal_by_name("ForceZ")
    assert (force_z.scale, force_z.maximum) == (0.005, 163.835)


def test_every_leg_has_every_frame_and_there_are_no_others() -> None:
    """Names, ids, lengths and senders are those of the codecs."""
    expected = {
        name + leg: (base + NODE_IDS[leg.lower()], length, sender)
        for name, (base, length, sender) in SENDERS.items()
        for leg in LEGS
    }
    expected |= {"Forces": (FORCES_ID, 64, "Footsense"), "Forces4": (FORCES4_ID, 24, "Footsense")}
    assert {m.name: (m.frame_id, m.length, m.senders[0]) for m in DBC.messages} == expected
    assert [message.name for message in DBC.messages if message.is_fd] == ["Forces", "Forces4"]
    assert DBC.get_message_by_name("Forces4").dbc.attributes["CANFD_BRS"].value == 1
    assert not any(message.is_extended_frame for message in DBC.messages)


@pytest.mark.parametrize("name", SENDERS)
def test_the_legs_differ_in_nothing_but_name_and_id(name: str) -> None:
    """Each leg's frame has the same signals, so that the others' tests hold for all."""
    first, *others = [
        [
            (
                s.name,
                s.start,
                s.length,
                s.is_signed,
                s.byte_order,
                s.scale,
                s.offset,
                s.unit,
                s.choices,
                s.comment,
            )
            for s in DBC.get_message_by_name(name + leg).signals
        ]
        for leg in LEGS
    ]
    assert all(other == first for other in others)
    assert all(signal[4] == "little_endian" and signal[9] for signal in first)


@pytest.mark.parametrize(
    ("message", "signal", "names"),
    [
        ("ForceLf", "State", State),
        ("FaultLf", "State", State),
        ("FaultLf", "PreviousState", State),
        ("FaultLf", "Cause", Cause),
        ("BaselineLf", "Status", BaselineStatus),
        ("GaitEventLf", "Kind", GaitEventKind),
        ("GaitLf", "Slip", Slip),
        ("CommandLf", "Kind", CommandKind),
        ("AnswerLf", "Kind", CommandKind),
        ("AnswerLf", "Result", Result),
        ("HeartbeatLf", "NmtState", NmtState),
    ],
)
def test_value_tables_are_the_enumerations(message: str, signal: str, names: type[IntEnum]) -> None:
    """A new state, command or result has to be entered in both."""
    choices = DBC.get_message_by_name(message).get_signal_by_name(signal).choices
    assert {code: str(name) for code, name in choices.items()} == camel(names)


def test_flags_are_single_bits_and_the_words_are_the_commands() -> None:
    """Each flag is a signal at its bit behind the counter; each word's letters name its command."""
    quality = DBC.get_message_by_name("QualityLf")
    for bit, name in camel(Flag).items():
        signal = quality.get_signal_by_name(name)
        assert (1 << (signal.start - 12), signal.length) == (bit, 1)
    words = DBC.get_message_by_name("CommandLf").get_signal_by_name("Word").choices
    assert {code: str(name) for code, name in words.items()} == {
        int.from_bytes(word, "little"): kind.name.title() for kind, word in COMMAND_WORDS.items()
    }


def test_cyclic_frames_tell_their_period_and_the_others_have_none() -> None:
    """Heartbeats come at 5 Hz, baselines at 1 Hz, gaits at 10 Hz, forces with every fourth conversion."""
    assert {m.name: m.cycle_time for m in DBC.messages if m.cycle_time} == {
        name + leg: period
        for name, period in (
            ("Force", 11),
            ("Quality", 11),
            ("Baseline", 1000),
            ("Gait", 100),
            ("Ground", 100),
            ("Heartbeat", 200),
        )
        for leg in LEGS
    } | {"Forces": 11, "Forces4": 11}


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
            draw(masks),
        )
        for _ in nodes
    ]
    return nodes, parts


@given(st.sampled_from([FORCES_ID, FORCES4_ID]), robots(), counters, st.integers(0, 254))
def test_forces_of_all_legs(can_id: int, robot: tuple[list[int], list[Any]], counter: int, age: int) -> None:
    """cantools, Python and the single frames agree on what one CAN FD frame says of every leg."""
    nodes, parts = robot
    state, force_n, sigma_n, flags, mask = zip(*parts, strict=True)
    t_ns, t_sent_ns = [1] * len(nodes), 1 + age * 500_000
    data = encode_forces(can_id, counter, t_sent_ns, nodes, t_ns, state, force_n, sigma_n, flags, mask)
    name = "Forces" if can_id == FORCES_ID else "Forces4"
    signals = decode(name, data)
    ours = decode_forces(can_id, data)
    assert (signals["CHECKSUM"], signals["COUNTER"]) == (int.from_bytes(data[:2], "little"), counter)
    assert signals["AllInAir"] == ours.all_in_air
    usable = [code in USABLE for code in state]
    assert ours.all_in_air == (all(usable) and not any(flag & Flag.CONTACT for flag in flags))
    shown = [code for node, code in zip(nodes, usable, strict=True) if node in NODES_OF_FRAME[can_id]]
    assert signals["Age"] == (age / 2 if any(shown) else 127.5)
    of_frame = [LEGS[node - 1] for node in NODES_OF_FRAME[can_id]]
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


@given(legs, counters, st.sampled_from(State), st.tuples(millinewtons, millinewtons, millinewtons))
def test_force(
    leg: str, counter: int, state: State, force_mn: tuple[int | None, int | None, int | None]
) -> None:
    """Each reads what the other writes."""
    name, node = f"Force{leg.capitalize()}", NODE_IDS[leg]
    force_n = tuple(math.nan if mn is None else mn / 1000 for mn in force_mn)
    data = encode_force(node, counter, state, force_n)
    signals = decode(name, data)
    ours = decode_force(FORCE_ID + node, data)
    assert (signals["CHECKSUM"], signals["COUNTER"], signals["State"]) == (data[0], counter, ours.state)
    read = [signals["ForceX"], signals["ForceY"], signals["ForceZ"]]
    assert read == pytest.approx([-32.768 if math.isnan(f) else f for f in ours.force_n])
    theirs = encode(name, signals)
    assert theirs == data


@given(legs, counters, st.integers(0, 15), st.one_of(st.none(), st.integers(0, 4094)), masks, sigma_codes)
def test_quality(leg: str, counter: int, flags: int, age: int | None, mask: int, sigma: int | None) -> None:
    """Each reads what the other writes."""
    name, node = f"Quality{leg.capitalize()}", NODE_IDS[leg]
    sigma_n = (math.nan if sigma is None else sigma / 500, 0.0, 0.02)
    data = encode_quality(node, counter, flags, None if age is None else age * 100_000, mask, sigma_n)
    signals = decode(name, data)
    assert signals == pytest.approx(
        {
            "CHECKSUM": data[0],
            "COUNTER": counter,
            "Simulated": flags & 1,
            "DegradedTiming": flags >> 1 & 1,
            "TareRefused": flags >> 2 & 1,
            "Contact": flags >> 3 & 1,
            "Age": 409.5 if age is None else age / 10,
            "FaultMask": mask,
            "SigmaX": 1.022 if sigma is None else sigma / 500,
            "SigmaY": 0.0,
            "SigmaZ": 0.02,
        }
    )
    theirs = encode(name, signals)
    assert decode_quality(QUALITY_ID + node, theirs)[:5] == decode_quality(QUALITY_ID + node, data)[:5]
    assert theirs == data


def test_codes_for_no_value_are_named() -> None:
    """A tool that shows value tables shows `NoValue`, not a number."""
    force = DBC.decode_message("ForceLf", encode_force(1, 0, State.STALE, (1.0, 1.0, 1.0)))
    assert [str(force[f"Force{axis}"]) for axis in "XYZ"] == ["NoValue"] * 3
    quality = DBC.decode_message("QualityLf", encode_quality(1, 0, 0, None, 0, (math.nan, 2.0, math.nan)))
    assert [str(quality[s]) for s in ("Age", "SigmaX", "SigmaY")] == ["NoValue", "NoValue", "Saturated"]


@given(legs, counters, st.sampled_from(State), st.sampled_from(State), masks, st.sampled_from(Cause))
def test_fault(leg: str, counter: int, state: State, previous: State, mask: int, cause: Cause) -> None:
    """Each reads what the other writes."""
    node = NODE_IDS[leg]
    signals = {
        "COUNTER": counter,
        "State": state,
        "PreviousState": previous,
        "FaultMask": mask,
        "Cause": cause,
    }
    theirs = encode(f"Fault{leg.capitalize()}", signals)
    assert decode_fault(FAULT_ID + node, theirs) == (node, counter, state, previous, mask, cause)
    assert theirs == encode_fault(node, counter, state, previous, mask, cause)


@given(
    legs,
    counters,
    st.sampled_from(BaselineStatus),
    offsets,
    offsets,
    st.one_of(st.none(), st.integers(0, 65534)),
)
def test_baseline(
    leg: str, counter: int, status: BaselineStatus, mean: int | None, worst: int | None, age: int | None
) -> None:
    """Each reads what the other writes, in fF and s here and in pF and ns there."""
    name, node = f"Baseline{leg.capitalize()}", NODE_IDS[leg]
    mean_pf, worst_pf = (math.nan if code is None else code / 10_000 for code in (mean, worst))
    age_ns = None if age is None else age * 100_000_000
    data = encode_baseline(node, counter, status, mean_pf, worst_pf, age_ns)
    signals = decode(name, data)
    assert signals == pytest.approx(
        {
            "CHECKSUM": data[0],
            "COUNTER": counter,
            "Status": status,
            "MeanOffset": -3276.8 if mean is None else mean / 10,
            "WorstOffset": -3276.8 if worst is None else worst / 10,
            "Age": 6553.5 if age is None else age / 10,
        }
    )
    theirs = encode(name, signals)
    assert decode_baseline(BASELINE_ID + node, theirs)[:3] == (node, counter, status)
    assert theirs == data


def number(code: int | None, per_unit: int) -> float:
    """Return the value of a code; NaN for none."""
    return math.nan if code is None else code / per_unit


@given(
    legs,
    counters,
    st.sampled_from(GaitEventKind),
    st.one_of(st.none(), st.integers(0, 65534)),
    st.one_of(st.none(), st.integers(0, 254)),
    st.booleans(),
)
def test_gait_event(
    leg: str,
    counter: int,
    kind: GaitEventKind,
    age: int | None,
    sigma: int | None,
    air: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    """Each reads what the other writes."""
    name, node = f"GaitEvent{leg.capitalize()}", NODE_IDS[leg]
    age_ns = None if age is None else age * 100_000
    data = encode_gait_event(node, counter, kind, age_ns, number(sigma, 5000), all_in_air=air)
    signals = decode(name, data)
    assert signals == pytest.approx(
        {
            "CHECKSUM": data[0],
            "COUNTER": counter,
            "Kind": kind,
            "Age": 6553.5 if age is None else age / 10,
            "Sigma": 51.0 if sigma is None else sigma / 5,
            "AllInAir": int(air),
        }
    )
    theirs = encode(name, signals)
    assert theirs == data
    ours = decode_gait_event(GAIT_EVENT_ID + node, theirs)
    assert ours == pytest.approx((node, counter, kind, age_ns, number(sigma, 5000), air), nan_ok=True)


shares = st.one_of(st.none(), st.integers(0, 200))


@given(legs, counters, st.sampled_from(Slip), st.tuples(*[st.booleans()] * 3), shares, shares)
def test_gait(
    leg: str,
    counter: int,
    slip: Slip,
    states: tuple[bool, bool, bool],
    probability: int | None,
    share: int | None,
) -> None:
    """Each reads what the other writes."""
    name, node = f"Gait{leg.capitalize()}", NODE_IDS[leg]
    contact, raw, air = states
    values = number(probability, 200), number(share, 200)
    data = encode_gait(node, counter, slip, *values, contact=contact, contact_raw=raw, all_in_air=air)
    signals = decode(name, data)
    assert signals == pytest.approx(
        {
            "CHECKSUM": data[0],
            "COUNTER": counter,
            "Contact": int(contact),
            "ContactRaw": int(raw),
            "AllInAir": int(air),
            "Slip": slip,
            "Probability": 1.275 if probability is None else probability / 200,
            "LoadShare": 1.275 if share is None else share / 200,
        }
    )
    theirs = encode(name, signals)
    assert theirs == data
    ours = decode_gait(GAIT_ID + node, theirs)
    assert ours == pytest.approx((node, counter, contact, raw, air, slip, *values), nan_ok=True)


@given(
    legs,
    counters,
    st.one_of(st.none(), st.tuples(st.integers(-350, 350), st.integers(-350, 350))),
    st.one_of(st.none(), st.integers(0, 126)),
    st.one_of(st.none(), st.integers(0, 510)),
    st.one_of(st.none(), st.integers(0, 62)),
    st.one_of(st.none(), st.integers(0, 510)),
)
def test_ground(
    leg: str,
    counter: int,
    normal: tuple[int, int] | None,
    sigma: int | None,
    use: int | None,
    use_sigma: int | None,
    friction: int | None,
) -> None:
    """Each reads what the other writes."""
    name, node = f"Ground{leg.capitalize()}", NODE_IDS[leg]
    x, y = (math.nan, math.nan) if normal is None else (normal[0] / 500, normal[1] / 500)
    unit = x, y, math.sqrt(1.0 - x * x - y * y)
    values = number(sigma, 400), number(use, 250), number(use_sigma, 250), number(friction, 250)
    data = encode_ground(node, counter, unit, *values)
    signals = decode(name, data)
    assert signals == pytest.approx(
        {
            "CHECKSUM": data[0],
            "COUNTER": counter,
            "NormalX": -1.024 if normal is None else x,
            "NormalY": -1.024 if normal is None else y,
            "NormalSigma": 0.3175 if sigma is None else sigma / 400,
            "TangentialOverNormal": 2.044 if use is None else use / 250,
            "TangentialOverNormalSigma": 0.252 if use_sigma is None else use_sigma / 250,
            "Friction": 2.044 if friction is None else friction / 250,
        }
    )
    theirs = encode(name, signals)
    assert theirs == data
    ours = decode_ground(GROUND_ID + node, theirs)
    assert ours.normal == pytest.approx(unit, nan_ok=True)
    assert ours[3:] == pytest.approx(values, nan_ok=True)


@given(legs, counters, st.sampled_from(CommandKind))
def test_command(leg: str, counter: int, kind: CommandKind) -> None:
    """A command written with the DBC's names is executed."""
    node, name = NODE_IDS[leg], kind.name.title()
    theirs = encode(f"Command{leg.capitalize()}", {"COUNTER": counter, "Kind": name, "Word": name})
    assert decode_command(COMMAND_ID + node, theirs) == (node, counter, kind)
    assert theirs == encode_command(node, counter, kind)


@given(
    legs, counters, st.sampled_from(Result), st.sampled_from(CommandKind), st.integers(0, UNSOLICITED_COUNTER)
)
def test_answer(leg: str, counter: int, result: Result, kind: CommandKind, asked: int) -> None:
    """Each reads what the other writes."""
    node = NODE_IDS[leg]
    signals = {"COUNTER": counter, "Result": result, "Kind": kind, "CommandCounter": asked}
    theirs = encode(f"Answer{leg.capitalize()}", signals)
    assert decode_answer(ANSWER_ID + node, theirs) == (node, counter, result, kind, asked)
    assert theirs == encode_answer(node, counter, result, kind, asked)


@pytest.mark.parametrize("degraded", [False, True])
@pytest.mark.parametrize("state", NmtState)
def test_heartbeat(state: NmtState, degraded: bool) -> None:  # noqa: FBT001 - a parameter of the test
    """The one byte has the DBC's names."""
    data = encode_heartbeat(state, degraded_timing=degraded)
    assert decode("HeartbeatRr", data) == {"NmtState": state, "DegradedTiming": degraded}
