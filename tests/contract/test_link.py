"""The consumer's decoder in C and in Python: the same vectors, the same answers to any frames."""

import ctypes
import json
import math
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.can.codes import (
    BaselineStatus,
    CalibrationKind,
    Cause,
    CommandKind,
    Flag,
    GaitEventKind,
    Result,
    State,
    StepPhase,
)
from firmware_interface.can.commands import ANSWER, COMMAND_ID, Answer, encode_command
from firmware_interface.can.crc8 import protect
from firmware_interface.can.force import FORCE_ID, QUALITY_ID
from firmware_interface.can.gait import (
    GAIT_EVENT,
    GAIT_EVENT_ID,
    LEG_MOTION,
    LEG_MOTION_ID,
    GaitEventFrame,
    LegMotionFrame,
)
from firmware_interface.can.reports import (
    FAULT,
    FAULT_ID,
    IDENTITY,
    IDENTITY_ID,
    PROTOCOL_VERSION,
    Fault,
    Identity,
)
from firmware_interface.can.socketcan import ERROR, EXTENDED, REMOTE
from footsense.client import CommandAnswer, GaitEvents, Link, LinkLimits, PendingCommands
from tests.contract import link_vectors
from tests.contract.c_decoder import SOURCES, CLink, compile_c, in_c_units, library
from tests.support.can_frames import encode_force, encode_quality

LINK = json.loads(link_vectors.PATH.read_text())


def test_the_vectors_are_those_that_the_script_makes() -> None:
    """Nobody changed one without the other."""
    assert link_vectors.document() == link_vectors.PATH.read_text(encoding="utf-8")


@pytest.mark.parametrize("case", LINK["cases"], ids=lambda case: case["name"])
def test_both_see_what_the_vectors_say(case: dict[str, Any]) -> None:
    """LinkStatus and use after every frame."""
    limits = LinkLimits(**case["limits"])
    ours, theirs = Link(limits), CLink(limits)
    for t_us, can_id, data, status, usable in case["steps"]:
        if can_id is not None:
            ours.feed(can_id, bytes.fromhex(data), t_us * 1000)
            theirs.feed(can_id, bytes.fromhex(data), t_us)
        view = ours.leg(LINK["node"], t_us * 1000)
        assert (view.status.name.lower(), view.usable) == (status, usable), t_us
        assert theirs.look(LINK["node"], t_us) == in_c_units(view), t_us


def identity_of(node: int, version: int = PROTOCOL_VERSION, step_mn: int = 1) -> tuple[int, bytes]:
    """Return id and data of an `Identity`."""
    return IDENTITY_ID + node, IDENTITY.encode(Identity(node, 0, version, step_mn, 7))


@st.composite
def streams(draw: st.DrawFn) -> list[tuple[int, int, bytes]]:
    """Return frames of two legs with times in us: mostly what a service sends, with every kind of harm."""
    frames = [(0, *identity_of(node)) for node in draw(st.sampled_from([(), (1,), *[range(1, 9)] * 4]))]
    t_us, counter = 0, draw(st.integers(0, 14))
    for harm in draw(st.lists(st.sampled_from(["none"] * 12 + list("lhqfcszxie")), max_size=40)):
        step_us = draw(st.sampled_from([0, 100, *[25_000] * 5, 99_999, 100_001, 300_001, -200_000]))
        t_us = max(0, t_us + step_us)
        step = draw(st.integers(2, 14)) if harm == "l" else 0 if harm == "z" else 1
        counter = (counter + step) % 15
        state = draw(st.sampled_from(State)) if harm == "s" else State.VALID
        node = draw(st.sampled_from([1, 1, 1, 2]))
        age_ns = draw(st.sampled_from([15_000_000, 15_000_000, 99_000_000, 100_100_000, None]))
        contact = draw(st.sampled_from([(1.0, 0.93), (0.004, math.nan), (math.nan, math.nan)]))
        sigma_n = draw(st.sampled_from([*[(0.01, 2.0, 0.02)] * 4, (0.01, 2.0, math.nan)]))
        sent = [
            (FORCE_ID + node, encode_force(node, counter, state, (0.1, -0.2, 40.0))),
            (QUALITY_ID + node, encode_quality(node, counter, 9, age_ns, sigma_n, *contact)),
        ]
        if harm == "h":
            del sent[draw(st.integers(0, 1))]
        if harm == "q":
            sent.reverse()
        if harm == "f":
            sent = [(draw(st.integers(0x100, 0x15F)), draw(st.binary(max_size=8)))]
        if harm == "c":
            sent[0] = (sent[0][0], protect(sent[0][0], draw(st.binary(min_size=7, max_size=7))))
        if harm == "x":
            sent[1] = (sent[1][0] ^ 3, sent[1][1])
        if harm == "i":
            told = identity_of(node, draw(st.sampled_from([3, 3, 2])), draw(st.integers(0, 21)))
            sent = draw(st.permutations([*sent, told]))
        if harm == "e":
            fault = Fault(node, 0, state, state, draw(st.integers(0, 511)), Cause.NONE)
            sent.append((FAULT_ID + node, FAULT.encode(fault)))
        frames += [(t_us + 270 * place, *frame) for place, frame in enumerate(sent)]
    return frames


@given(
    streams(),
    st.builds(
        LinkLimits, max_delta=st.integers(1, 14), min_good=st.integers(0, 4), accept_degraded=st.booleans()
    ),
    st.integers(0, 200_000),
)
def test_both_see_the_same_in_any_frames(
    frames: list[tuple[int, int, bytes]], limits: LinkLimits, later_us: int
) -> None:
    """Every field of every view, right after each frame and some time later, clocks that step back included."""
    ours, theirs = Link(limits), CLink(limits)
    for t_us, can_id, data in frames:
        assert ours.feed(can_id, data, t_us * 1000) == theirs.feed(can_id, data, t_us)
        for node in (1, 2, 7):
            for at_us in (t_us, t_us + later_us):
                view = ours.leg(node, at_us * 1000)
                assert theirs.look(node, at_us) == in_c_units(view)
                assert not view.usable or (view.age_ns is not None and view.age_ns <= limits.max_age_ns)
                assert not view.usable or all(sigma_n >= 0.0 for sigma_n in view.sigma_n)
                told = ours.identity(node)
                assert not view.usable or (told is not None and told.is_known)


@pytest.mark.parametrize("flag", [EXTENDED, REMOTE, ERROR])
def test_frames_of_other_kinds_are_not_ours(flag: int) -> None:
    """An extended, a remote and an error frame whose lower bits are the id of a leg's force change nothing."""
    can_id = FORCE_ID + 1
    data = encode_force(1, 0, State.VALID, (0.1, -0.2, 0.5))
    ours, theirs = Link(), CLink(LinkLimits())
    assert ours.feed(can_id, data, 0) is theirs.feed(can_id, data, 0) is True
    assert ours.feed(can_id | flag, data, 0) is theirs.feed(can_id | flag, data, 0) is False
    header = (SOURCES / "footsense_can.h").read_text()
    assert re.search(rf"#define FOOTSENSE_(EXTENDED|REMOTE|ERROR) 0x{flag:X}u", header)


@given(st.integers(0, 8), st.integers(0, 16), st.integers(0, 5))
def test_c_writes_the_commands_of_python_and_none_other(node: int, counter: int, kind: int) -> None:
    """The id is 0 for a node, counter or kind that does not exist."""
    data = ctypes.create_string_buffer(8)
    can_id = library().footsense_encode_command(node, counter, kind, data)
    if 1 <= node <= 8 and counter <= 14 and kind in set(CommandKind):
        assert (can_id, data.raw) == (COMMAND_ID + node, encode_command(node, counter, CommandKind(kind)))
    else:
        assert can_id == 0


class _CMotion(ctypes.Structure):
    _fields_ = (
        ("phase", ctypes.c_uint8),
        ("acceleration_cm_per_s2", ctypes.c_int16),
        ("sigma_mm_per_s2", ctypes.c_uint32),
        ("up_permille", ctypes.c_int16 * 2),
    )


@given(
    *(st.integers(0, 9), st.integers(0, 15), st.integers(0, 3), st.integers(-(1 << 15), (1 << 15) - 1)),
    st.one_of(st.integers(0, 600_000), st.integers(0, (1 << 32) - 1)),
    st.one_of(st.tuples(st.integers(-1000, 1000), st.integers(-1000, 1000)), st.just((-32768, -32768))),
)
def test_c_writes_the_motions_of_python_and_none_other(
    node: int, counter: int, phase: int, acceleration: int, sigma: int, up: tuple[int, int]
) -> None:
    """The id is 0 for a node, counter, phase or direction that does not exist; the least or largest number is none."""
    data = ctypes.create_string_buffer(8)
    motion = _CMotion(phase, acceleration, sigma, up)
    can_id = library().footsense_encode_motion(node, counter, ctypes.byref(motion), data)
    x, y = (math.nan if part == -32768 else part / 1000 for part in up)
    if not (1 <= node <= 8 and counter <= 14 and phase in set(StepPhase)) or x * x + y * y > 1.0:
        assert can_id == 0
        return
    in_python = LegMotionFrame(
        *(node, counter, StepPhase(phase)),
        math.nan if acceleration == -32768 else acceleration / 100,
        math.nan if sigma == (1 << 32) - 1 else sigma / 1000,
        (x, y, math.nan),
    )
    assert (can_id, data.raw) == (LEG_MOTION_ID + node, LEG_MOTION.encode(in_python))


class _CEvent(ctypes.Structure):
    _fields_ = (
        ("node", ctypes.c_uint8),
        ("kind", ctypes.c_uint8),
        ("all_in_air", ctypes.c_bool),
        ("has_time", ctypes.c_bool),
        ("sigma_us", ctypes.c_uint16),
        ("t_us", ctypes.c_uint64),
    )


gait_frames = st.builds(
    lambda node, counter, kind, age_us, harm: (
        GAIT_EVENT_ID + node + (harm == 0),
        GAIT_EVENT.encode(GaitEventFrame(node, counter, kind, 1000 * age_us, 0.002, all_in_air=harm == 1))[
            : 6 - (harm == 2)
        ],
    ),
    st.integers(1, 2),
    st.integers(0, 2),
    st.sampled_from(GaitEventKind),
    st.sampled_from([0, 11_200, 7_000_000]),
    st.integers(0, 8),
)


@given(st.lists(st.tuples(gait_frames, st.sampled_from([0, 100, 500_000, 999_999, 1_000_000])), max_size=20))
def test_both_take_the_same_events_and_none_twice(traffic: list[tuple[tuple[int, bytes], int]]) -> None:
    """Repeated frames, wrong ones, and those of a service that was started anew."""
    take = library().footsense_take_event
    take.restype = ctypes.c_bool
    state, ours, t_us = ctypes.create_string_buffer(256), GaitEvents(), 10_000_000
    for (can_id, data), step_us in traffic:
        t_us += step_us
        event, out = ours.feed(can_id, data, 1000 * t_us), _CEvent()
        frame = ctypes.c_uint32(can_id), data, ctypes.c_uint8(len(data))
        taken = take(state, *frame, ctypes.c_uint64(t_us), ctypes.byref(out))
        assert taken == (event is not None)
        if event is not None:
            t_ns = 1000 * out.t_us if out.has_time else None
            assert (event.node, event.kind, event.t_ns) == (out.node, out.kind, t_ns)
            assert (event.all_in_air, round(event.sigma_s * 1e6)) == (out.all_in_air, out.sigma_us)


def test_the_codes_of_the_header_are_those_of_python() -> None:
    """C has the names that it acts on, and how far the others go."""
    header = (SOURCES / "footsense_can.h").read_text()
    named = {name: int(code) for name, code in re.findall(r"FOOTSENSE_(\w+) = (\d+)", header)}
    states = {"TOO_OLD" if state is State.STALE else state.name: state.value for state in State}
    flags = {flag.name: flag.value for flag in Flag}
    commands = {kind.name: kind.value for kind in CommandKind}
    events = {kind.name: kind.value for kind in GaitEventKind}
    phases = {f"PHASE_{phase.name}": phase.value for phase in StepPhase}
    kinds = {f"CALIBRATION_{kind.name}": kind.value for kind in CalibrationKind}
    assert named == states | flags | commands | events | phases | kinds | {"DONE": Result.DONE.value}
    limits = re.search(
        r"LAST_CAUSE = (\d+), LAST_BASELINE_STATUS = (\d+), LAST_RESULT = (\d+),\s+LAST_CALIBRATION_KIND = (\d+)",
        (SOURCES / "footsense_can.c").read_text(),
    )
    assert limits
    assert list(map(int, limits.groups())) == [
        *(max(Cause), max(BaselineStatus), max(Result), max(CalibrationKind))
    ]


def test_the_example_in_the_readme_compiles(tmp_path: Path) -> None:
    """Without a warning, against the headers alone."""
    example = re.search(r"```c\n(.*?)```", (SOURCES / "README.md").read_text(), re.DOTALL)
    assert example
    (tmp_path / "example.c").write_text(example[1])
    compile_c(tmp_path, "-c", f"-I{SOURCES}", "example.c", "-o", "example.o")


def test_an_answer_ends_the_command_that_it_names() -> None:
    """Each command has its own counter; what answers nothing that is open, or is broken, ends nothing."""
    commands = PendingCommands(first_counter=14)
    assert commands.encode(2, CommandKind.TARE, 0) == (0x112, encode_command(2, 14, CommandKind.TARE))
    assert commands.encode(2, CommandKind.TARE, 10) == (0x112, encode_command(2, 0, CommandKind.TARE))
    answer = ANSWER.encode(Answer(2, 5, Result.LOADED, CommandKind.TARE, 0))
    broken = answer[:-1] + b"\x03"
    others = [
        (0x143, answer),
        (0x142, broken),
        (0x14A, b"\x05"),
        (0x142, ANSWER.encode(Answer(2, 4, Result.DONE, 9, 0))),
    ]
    assert [commands.feed(*other, 20) for other in others] == [None] * 4
    assert commands.feed(0x142, answer, 30) == CommandAnswer(2, CommandKind.TARE, Result.LOADED, 20)
    assert commands.feed(0x142, answer, 40) is None
