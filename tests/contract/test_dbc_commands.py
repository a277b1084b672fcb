"""Commands, answers and heartbeats: the DBC and the Python codecs are two accounts of the same frames."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.can.codes import (
    NODE_IDS,
    CommandKind,
    NmtState,
    Result,
)
from firmware_interface.can.commands import (
    ANSWER_ID,
    COMMAND_ID,
    UNSOLICITED_COUNTER,
    decode_answer,
    decode_command,
    encode_answer,
    encode_command,
)
from firmware_interface.can.reports import encode_heartbeat
from tests.contract.dbc import (
    counters,
    decode,
    encode,
    legs,
)


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
