"""The DBC of a robot with eight legs: its frames, legs, value tables, flags and periods are those of the codecs."""

from enum import IntEnum

import cantools
import pytest

from firmware_interface.can.codes import (
    NODE_IDS,
    BaselineStatus,
    CalibrationKind,
    Cause,
    CommandKind,
    GaitEventKind,
    NmtState,
    Result,
    State,
    StepPhase,
)
from firmware_interface.can.dbc import HEXAPOD_DBC, make_dbc
from tests.contract.test_frames import DBC, FRAMES, SENT_BY_CONTROLLER, dbc_name

LEGS = [leg.capitalize() for leg in NODE_IDS]


def test_the_dbc_of_a_hexapod_is_the_committed_one() -> None:
    """Byte for byte; others have the frames of their legs, and forces in their own unit."""
    assert make_dbc(["lf", "lm", "lr", "rf", "rm", "rr"]) == HEXAPOD_DBC.read_text("utf-8")
    trotting = make_dbc(["lf", "lr", "rf", "rr"], force_step_mn=5)
    assert '"footsense: the contact force of every foot of a four-legged robot' in trotting
    four = cantools.database.load_string(trotting, "dbc")
    assert {m.name[-2:] for m in four.messages} == {"Lf", "Lr", "Rf", "Rr"}
    force_z = four.get_message_by_name("ForceRr").get_signal_by_name("ForceZ")
    assert (force_z.scale, force_z.maximum) == (0.005, 163.835)


def test_every_leg_has_every_frame_and_there_are_no_others() -> None:
    """Names, ids and senders are those of the codecs."""
    expected = {
        dbc_name(kind, leg): (
            frame.base + node,
            "GaitController" if kind in SENT_BY_CONTROLLER else "Footsense",
        )
        for kind, frame in FRAMES.items()
        for leg, node in NODE_IDS.items()
    }
    assert {m.name: (m.frame_id, m.senders[0]) for m in DBC.messages} == expected
    assert not any(message.is_extended_frame or message.is_fd for message in DBC.messages)


@pytest.mark.parametrize(
    ("message", "signal", "names"),
    [
        ("ForceLf", "State", State),
        ("FaultLf", "State", State),
        ("FaultLf", "PreviousState", State),
        ("FaultLf", "Cause", Cause),
        ("BaselineLf", "Status", BaselineStatus),
        ("GaitEventLf", "Kind", GaitEventKind),
        ("LegMotionLf", "Phase", StepPhase),
        ("CalibrationLf", "Kind", CalibrationKind),
        ("CommandLf", "Kind", CommandKind),
        ("AnswerLf", "Kind", CommandKind),
        ("AnswerLf", "Result", Result),
        ("HeartbeatLf", "NmtState", NmtState),
    ],
)
def test_value_tables_are_the_enumerations(message: str, signal: str, names: type[IntEnum]) -> None:
    """A new state, command or result has to be entered in both."""
    choices = DBC.get_message_by_name(message).get_signal_by_name(signal).choices
    assert {code: str(name) for code, name in choices.items()} == {
        member.value: member.name.title().replace("_", "") for member in names
    }


def test_cyclic_frames_tell_their_period_and_the_others_have_none() -> None:
    """Heartbeats at 5 Hz, other reports at 1 Hz, grounds at 10 Hz, forces at the 72 Hz of six legs on AD7147."""
    assert {m.name: m.cycle_time for m in DBC.messages if m.cycle_time} == {
        name + leg: period
        for name, period in (
            ("Force", 14),
            ("Quality", 14),
            ("Baseline", 1000),
            ("Identity", 1000),
            ("Calibration", 1000),
            ("Fault", 1000),
            ("Ground", 100),
            ("Heartbeat", 200),
        )
        for leg in LEGS
    }
