"""What `footsense monitor` shows: what a real sink sends, and nothing that is not known."""

import io
import math
from collections.abc import Sequence
from typing import Any

import msgspec
import pytest
from click.testing import CliRunner
from rich.console import Console

from firmware_interface.can.codes import (
    BaselineStatus,
    CalibrationKind,
    Cause,
    Flag,
    GaitEventKind,
    NmtState,
    State,
)
from firmware_interface.can.force import FORCE_ID
from firmware_interface.can.gait import Ground
from firmware_interface.can.reports import (
    BASELINE,
    BASELINE_ID,
    FAULT,
    FAULT_ID,
    HEARTBEAT_ID,
    IDENTITY,
    IDENTITY_ID,
    Baseline,
    CalibrationFrame,
    Fault,
    Heartbeat,
    Identity,
    encode_heartbeat,
    foot_type_hash,
)
from firmware_interface.can.socketcan import pack_frame
from footsense.cli import main
from footsense.cli.monitor import COLUMNS, monitor, monitor_tables
from footsense.cli.tables import json_row
from footsense.client import LegForce, LegReport, LinkLimits, LinkStatus, Reports
from footsense.client.listener import LegSnapshot, Listener
from footsense.errors import CanError
from footsense.frames import LEGS, GaitEvent
from footsense.wires.address import CanAddress
from footsense.wires.opening import open_wire
from tests.support.can_robot import MS, FakeClock, Robot
from tests.support.frames import gait_frame


def snapshot(leg: str) -> LegSnapshot:
    """Return a leg of which everything is told, in the longest words."""
    force = LegForce(
        status=LinkStatus.REPEATED,
        usable=True,
        state=State.CONVERTER_FAULT,
        flags=Flag.SIMULATED | (Flag.CONTACT if leg == "lf" else Flag(0)),
        fault_mask=0b100_000_011,
        force_n=(-12.3456, -0.0, 32.767),
        sigma_n=(0.1, math.nan, 1.02),
        age_ns=99_900_000,
        contact_probability=1.0,
        holds=0.25,
    )
    report = LegReport(
        fault=Fault(1, 0, State.CONVERTER_FAULT, State.VALID, 0, Cause.ELEMENT_SHORTED),
        baseline=Baseline(1, 0, BaselineStatus.NOT_QUIET, -1.2345, 3.2767, 6_553_400_000_000),
        heartbeat=Heartbeat(1, NmtState.STOPPED, degraded_timing=True),
        ground=Ground(1, 0, (-0.7, -0.7, 0.14), 0.315, 2.04, 0.248, 2.04),
        calibration=CalibrationFrame(1, 0, CalibrationKind.STANDING, 2159, math.nan, math.nan),
    )
    return LegSnapshot(leg, force, report, 7, rate_hz=364)


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_the_longest_words_fit_into_80_columns_and_a_small_terminal(encoding: str) -> None:
    """No line is folded or cut, on a terminal that knows ASCII alone."""
    screen = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    console = Console(file=screen, width=80, force_terminal=True, color_system=None)
    console.print(monitor_tables([snapshot(leg) for leg in LEGS], "239.74.163.2", 12345.6, 80))
    screen.seek(0)
    text = screen.read()
    assert len(text.splitlines()) <= 23
    assert all(len(line) <= 80 for line in text.splitlines())
    assert "timing degraded" in text
    for word in (
        "converter fault",
        "element shorted",
        "xx. ... ..x",
        "not quiet",
        "6553.4",
        "-12.346",
        "25%",
        "18.0",
        " 364",
    ):
        assert text.count(word) == 6
    assert "…" not in text


@pytest.mark.parametrize(
    ("width", "headings"),
    [
        (
            200,
            (
                "leg state link foot fx [N] fy [N] fz [N] sigma age [ms] Hz | "
                "leg contact holds ft/fn +- friction normal x y +- [deg] | "
                "leg cause elements baseline mean fF worst ago [s] node calibration since +- [%] +- [deg]"
            ),
        ),
        (
            60,
            (
                "leg state foot fx [N] fy [N] fz [N] | leg contact holds ft/fn +- friction normal x y | "
                "leg cause elements baseline node"
            ),
        ),
        (40, "leg state foot fz [N] | leg contact holds ft/fn friction | leg cause elements"),
    ],
)
def test_a_narrow_terminal_loses_what_is_worth_least(width: int, headings: str) -> None:
    screen = io.StringIO()
    legs = [snapshot(leg) for leg in LEGS]
    Console(file=screen, width=width, color_system=None).print(monitor_tables(legs, "can0", 1.0, width))
    lines = screen.getvalue().splitlines()
    titles = [" ".join(line.split()) for line in lines if line.startswith("leg ")]
    assert " | ".join(titles) == headings
    assert ("a wider terminal shows more" in lines) is (width < 200)
    assert [line[:2] for line in lines if line.startswith(LEGS)] == 3 * list(LEGS)
    assert max(len(line) for line in lines) <= width


def test_a_calibration_is_shown_with_its_date() -> None:
    """As numbers of JSON; what is not known of it is null."""
    assert json_row(COLUMNS, snapshot("lf"))["calibration"] == {
        "kind": "standing",
        "date": "2025-11-29",
        "size_error_percent": None,
        "direction_error_deg": None,
    }


def test_a_silent_channel_is_told_by_its_name(request: pytest.FixtureRequest) -> None:
    """Before the first frame, and again when none comes any more."""

    def shown() -> str:
        screen = io.StringIO()
        legs = listener.snapshot()
        Console(file=screen, width=80, color_system=None).print(monitor_tables(legs, "can0", 1.0, 80))
        return screen.getvalue()

    line, clock = "no frames on can0; is the service running?", FakeClock()
    wire = open_wire(CanAddress("virtual", request.node.nodeid))
    listener = Listener(wire, clock, LinkLimits())
    robot = Robot(request.node.nodeid, ("lf", "rr"))
    assert line in shown()
    robot.publish(0)
    listener.listen(500 * MS)
    assert line not in shown()
    listener.listen(3000 * MS)
    assert line in shown()
    robot.close()


def plain(listener: Listener) -> list[dict[str, Any]]:
    """Return what one second of --json says, read back."""
    return [msgspec.json.decode(msgspec.json.encode(json_row(COLUMNS, each))) for each in listener.snapshot()]


def test_a_listener_sees_what_a_sink_sends_and_stops_believing_it(request: pytest.FixtureRequest) -> None:
    """Over one channel in virtual time: three scans until trust, then silence."""
    clock = FakeClock()
    listener = Listener(open_wire(CanAddress("virtual", request.node.nodeid)), clock, LinkLimits())
    robot = Robot(request.node.nodeid, ("lf", "rr"), step_mn=10)
    assert plain(listener) == []
    for number in range(4):
        robot.publish(number * 25 * MS, State.VALID, age_ns=15 * MS)
        listener.listen(clock.t_ns + 25 * MS)
        assert listener.snapshot()[0].force.usable == (number >= 2)
    left, right = plain(listener)
    assert (left["leg"], left["link"], left["phase"], left["cause"]) == ("lf", "ok", "valid", "none")
    assert (left["forces"], left["heartbeat"], left["force_n"]) == (4, "operational", [0.5, 0.5, 0.5])
    assert 15.0 <= left["age_ms"] <= 45.0
    assert right["usable"]
    assert (left["force_step_mn"], left["foot_type_hash"]) == (10, f"{foot_type_hash('aoyagi-3x3'):08x}")
    assert left["rate_hz"] is None

    listener.listen(clock.t_ns + 900 * MS)
    assert plain(listener)[0]["rate_hz"] == 3
    listener.listen(clock.t_ns + 100 * MS)
    left = plain(listener)[0]
    assert left["rate_hz"] == 0
    assert (left["link"], left["usable"], left["heartbeat"]) == ("stale", False, None)
    assert (left["force_n"], left["age_ms"], left["contact"]) == ([None] * 3, None, None)
    assert (left["state"], left["cause"], left["elements_out"]) == (None, None, None)
    robot.close()


@pytest.mark.parametrize(("version", "step_mn"), [(2, 1), (3, 7)])
def test_frames_that_it_cannot_read_are_one_clear_line(
    request: pytest.FixtureRequest, version: int, step_mn: int
) -> None:
    """A version and a step that came later: no force that is ten times too little."""
    wire = open_wire(CanAddress("virtual", request.node.nodeid))
    listener = Listener(wire, FakeClock(), LinkLimits())
    told = IDENTITY.encode(Identity(2, 0, version, step_mn, 0))
    sender = open_wire(CanAddress("virtual", request.node.nodeid))
    sender.send([pack_frame(IDENTITY_ID + 2, told)], 0)
    with pytest.raises(CanError, match=rf"lm .*version {version} .*{step_mn} mN.* install") as caught:
        listener.listen(20 * MS)
    assert "\n" not in str(caught.value)
    sender.close()
    listener.close()


def test_contact_ground_and_the_last_event_are_shown(request: pytest.FixtureRequest) -> None:
    """As numbers of JSON, as long as they come; an event stays the last one."""
    clock = FakeClock()
    listener = Listener(open_wire(CanAddress("virtual", request.node.nodeid)), clock, LinkLimits())
    robot = Robot(request.node.nodeid)
    slip = gait_frame(0, events=(GaitEvent(GaitEventKind.SLIP, 0, -10 * MS, 0.01),))
    for gait in (None, slip, None):
        robot.publish(0, age_ns=1, contact_probability=1.0, holds=0.93, gait=gait)
    listener.listen(clock.t_ns + 50 * MS)
    (left,) = plain(listener)
    assert (left["contact_probability"], left["holds"]) == (1.0, 0.93)
    assert left["ground"]["ago_ms"] == 50.0
    assert left["ground"]["normal"] == pytest.approx([0.28, 0.0, 0.96])
    assert (left["ground"]["tangential_over_normal"], left["ground"]["friction"]) == (0.2, 0.6)
    assert left["last_event"] == {"kind": "slip", "ago_ms": 60.0, "sigma_ms": 10.0}
    listener.listen(clock.t_ns + 400 * MS)
    left = plain(listener)[0]
    assert (left["ground"], left["contact_probability"]) == (None, None)
    assert left["last_event"]["ago_ms"] == 460.0
    robot.close()


def test_a_channel_that_goes_away_is_one_line() -> None:
    """Not a traceback, and not a table that stands still."""

    class Gone:
        def send(self, frames: Sequence[bytes], t_ns: int) -> int:
            raise AssertionError("who only listens sends nothing")

        def receive(self) -> list[bytes]:
            raise OSError(100, "Network is down")

        def close(self) -> None:
            raise AssertionError("who was handed a channel does not close it")

    with pytest.raises(CanError, match="the CAN channel is gone: Network is down"):
        Listener(Gone(), FakeClock(), LinkLimits()).listen(1)


def test_reports_are_known_as_long_as_they_come() -> None:
    """A baseline and a cause for three seconds, a heartbeat for three beats; a wrong one is counted."""
    reports = Reports()
    assert reports.leg(3, 0) == LegReport()
    begin_ns = 70_000 * MS
    baseline = Baseline(3, 0, BaselineStatus.HELD, 0.001, -0.002, 5_000_000_000)
    beat = Heartbeat(3, NmtState.OPERATIONAL, degraded_timing=True)
    fault = Fault(3, 0, State.DEGRADED, State.VALID, 1, Cause.ELEMENT_OPEN)
    reports.feed(BASELINE_ID + 3, BASELINE.encode(baseline), begin_ns)
    reports.feed(HEARTBEAT_ID + 3, encode_heartbeat(beat.state, degraded_timing=True), begin_ns)
    reports.feed(FAULT_ID + 3, FAULT.encode(fault), begin_ns)
    aged = [baseline._replace(age_ns=(5000 + later_ms) * MS) for later_ms in (600, 601, 3000)]
    assert reports.leg(3, begin_ns + 600 * MS) == LegReport(fault, aged[0], beat)
    assert reports.leg(3, begin_ns + 601 * MS) == LegReport(fault, aged[1])
    assert reports.leg(3, begin_ns + 3000 * MS) == LegReport(fault, aged[2])
    assert reports.leg(3, begin_ns + 3000 * MS + 1) == LegReport()
    assert reports.feed(BASELINE_ID + 3, bytes(8), begin_ns)
    assert reports.feed(BASELINE_ID + 4, bytes(8), begin_ns)
    assert not reports.feed(FORCE_ID + 3, bytes(8), begin_ns)
    assert reports.leg(3, begin_ns).baseline == baseline


def test_a_channel_that_cannot_be_is_refused_with_one_that_can() -> None:
    """Before anything is opened."""
    udp = ["--interface", "udp_multicast"]
    for name, options in (("can0", udp), ("239.74.163", []), ("10.0.0.1", []), ("ff15::1", [])):
        for channel in (["--channel", name], [name]):
            result = CliRunner().invoke(monitor, [*options, *channel])
            assert result.exit_code == 2
            assert f"channel '{name}' is no IPv4 multicast address; try 239.74.163.2" in result.output


@pytest.mark.parametrize("options", ["--duration 0.3", "--duration 1.3", "--timeout 0.4", "--once", ""])
def test_a_channel_on_which_nothing_was_heard_is_a_failure(options: str) -> None:
    """Told once, whether the first second is over or not; where nobody watches, without an option too."""
    arguments = ["monitor", "239.74.163.77", *options.split()]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 1
    told = (
        "footsense: no frames on 239.74.163.77; is the service running, and is this its channel? (simulated: "
    )
    assert result.output == f"{told}with --config deploy/simulated.yaml)\n"
