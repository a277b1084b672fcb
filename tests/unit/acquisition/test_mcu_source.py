"""Frames out of a microcontroller's stream, in virtual time, whatever happens to it and to the line."""

from binascii import crc_hqx
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_interface.serial_frames import (
    FRAME_BYTES,
    IDENTIFY,
    NO_VALUE_BASE,
    RECORD_BITS,
    SENDING_BITS,
    Record,
    RecordFlag,
    Sending,
    encode_record,
    encode_sending,
    pack_values,
    stuff,
    unstuff,
)
from footsense.acquisition.mcu_source import McuSource, Serial
from footsense.frames import LEGS, CapFrame, Reading
from footsense.sim.clock import VirtualClock
from footsense.sim.robot_on_mcu import SimulatedRobotMcu
from tests.support.failing_line import FailingLine, LineFaults

MS, S = 1_000_000, 1_000_000_000
RATE_HZ, BAUD = 200.0, 921_600
PERIOD_NS = 5 * MS


def serial(legs: tuple[Any, ...], baud: int = BAUD) -> Serial:
    return Serial(device="sim", rate_hz=RATE_HZ, baud=baud, legs=legs)


def elements_pf(leg: int, t_ns: int) -> NDArray[np.float64]:
    """Return distinct capacitances that tell their time by a ramp of 1 pF/s."""
    return np.asarray(5.0 + 0.01 * leg + 0.001 * np.arange(9) + t_ns * 1e-9, np.float64)


class Robot:
    """A controller, its line and the source, with the time that each frame was read at.

    Args:
        faults: What goes wrong on the line.
        step_us: Time from element to element [us].
        starts_us: Clock of the controller at the begin [us].
        silent: Legs that do not answer from 1 s to 2 s.
    """

    def __init__(
        self,
        faults: LineFaults = LineFaults(),  # noqa: B008 - a tuple
        *,
        step_us: int = 0,
        starts_us: int = 0,
        silent: tuple[str, ...] = (),
    ) -> None:
        self.clock = VirtualClock()

        def reading_pf(leg: str, t_ns: int) -> NDArray[np.float64]:
            silent_now = leg in silent and S <= t_ns < 2 * S
            return np.full(9, np.nan) if silent_now else elements_pf(LEGS.index(leg), t_ns)

        mcu = SimulatedRobotMcu({leg: partial(reading_pf, leg) for leg in LEGS}, step_us=step_us)
        mcu.started_ns = -round(starts_us * 1000 / (1 + 40e-6))  # its clock is fast by 40 ppm
        line = FailingLine(mcu, self.clock, rate_hz=RATE_HZ, bits_per_s=BAUD, faults=faults)
        self.source = McuSource(line, self.clock, serial(LEGS))

    def run(self, until_ns: int) -> list[tuple[int, CapFrame]]:
        """Return the frames until a time, with the time of each."""
        frames = []
        while self.clock.now_ns() < until_ns:
            frame = self.source.read()
            frames.append((self.clock.now_ns(), frame))
        return frames


def late_ns(frame: CapFrame) -> NDArray[np.float64]:
    """Return how much later than true every stamp of a frame is, as its ramp tells [ns], NaN without a reading."""
    base_pf = 5.0 + 0.01 * np.arange(6)[:, None] + 0.001 * np.arange(9)
    return frame.t_ns - (frame.capacitance_pf - base_pf) * 1e9


@pytest.mark.parametrize("step_us", [0, 500])
@pytest.mark.parametrize("starts_us", [0, 2**32 - 2_000_000])
def test_every_element_lands_at_its_place_and_time(step_us: int, starts_us: int) -> None:
    """To 60 us, past the wrap of the clock; a frame goes on when its last record is there."""
    robot = Robot(step_us=step_us, starts_us=starts_us)
    frames = robot.run(4 * S)
    assert len(frames) == pytest.approx(790, abs=2)
    way_ns = 6 * 52 * 10 * S / BAUD
    for now_ns, frame in frames[20:]:
        assert not frame.reading.any()
        assert (np.abs(late_ns(frame)) < 60_000).all()
        assert now_ns - frame.t_ns.max() < way_ns + 60_000
    assert np.diff([frame.t_ns.max() for _, frame in frames]).min() > 4 * MS
    assert [frame.sequence for _, frame in frames] == list(range(len(frames)))
    assert not any(robot.source.losses.values())


def test_a_reset_is_said_and_costs_a_frame(caplog: pytest.LogCaptureFixture) -> None:
    """Clock and numbers begin anew; no record counts as lost but the one that was cut off."""
    robot = Robot(LineFaults(resets_ns=[3 * S]))
    frames = robot.run(6 * S)
    losses = robot.source.losses
    assert {kind: n for kind, n in losses.items() if n} == {"restarts": 6, "clock jumps": 1, "length": 1}
    poor = [now_ns for now_ns, frame in frames[1:] if frame.reading.any()]
    assert len(poor) == 1
    assert 3 * S <= poor[0] < 3 * S + 15 * MS
    assert all((np.abs(late_ns(frame)[frame.reading == 0]) < 4 * MS).all() for _, frame in frames[1:])
    assert "serial line of the microcontroller: " in caplog.text


def test_a_leg_that_does_not_answer_says_so_and_delays_nobody() -> None:
    """Its record comes, without values."""
    robot = Robot(silent=("rm",))
    frames = robot.run(3 * S)
    silent = np.array([(frame.reading[4] == Reading.NO_ANSWER).all() for _, frame in frames])
    assert silent.sum() == pytest.approx(200, abs=1)
    assert not np.delete(np.array([frame.reading for _, frame in frames[1:]]), 4, axis=1).any()
    assert all((frame.t_ns[4] == 0).all() for (_, frame), s in zip(frames, silent, strict=True) if s)


class Script:
    """A port that hands over what a test puts in.

    Args:
        clock: Virtual time.
    """

    def __init__(self, clock: VirtualClock) -> None:
        self.n_opened = 1
        self.due: list[tuple[int, bytes]] = []
        self.written = b""
        self._clock = clock

    def read(self) -> bytes:
        ready = b"".join(data for t_ns, data in self.due if t_ns <= self._clock.now_ns())
        self.due = [one for one in self.due if one[0] > self._clock.now_ns()]
        return ready

    def wait_for_bytes_until_ns(self, t_ns: int) -> None:
        self._clock.sleep_until_ns(min([t_ns, *(at_ns for at_ns, _ in self.due)]))

    def write(self, data: bytes) -> None:
        self.written += data

    def close(self) -> None: ...


def line(leg: int, scan: int, values: list[int] | None = None, step_us: int = 0) -> bytes:
    """Return a leg's record of a scan at 200 Hz."""
    packed = pack_values(values or [5_000_000] * 9)
    return encode_record(Record(leg, scan & 0xFFFF, RecordFlag(0), step_us, 5000 * scan, packed))


def test_a_leg_that_stops_delays_the_others_no_longer_than_it_is_waited_for() -> None:
    """Held up at first, then it does not answer and is not waited for; when it is back, it is in the next scan."""
    clock = VirtualClock()
    port = Script(clock)
    source = McuSource(port, clock, serial(("lf", "lm")))
    port.due = [
        ((n + 10) * PERIOD_NS + MS, line(1, n) + (b"" if 10 <= n < 30 else line(2, n))) for n in range(1, 40)
    ]
    frames = []
    while clock.now_ns() < 49 * PERIOD_NS:
        frame = source.read()
        now_ns, t_ns = clock.now_ns() - 10 * PERIOD_NS, frame.t_ns[0, 0] - 10 * PERIOD_NS
        frames.append((now_ns // PERIOD_NS, t_ns // PERIOD_NS, int(frame.reading[1, 0])))
    assert all(frame[0] == frame[1] for frame in frames if not 10 <= frame[0] < 16)
    second = {scan: reading for _, scan, reading in frames}
    assert [second[n] for n in (9, 10, 12, 13, 29, 31, 38)] == [
        Reading.OK,
        Reading.DELAYED,
        Reading.DELAYED,
        Reading.NO_ANSWER,
        Reading.NO_ANSWER,
        Reading.OK,
        Reading.OK,
    ]
    assert len(frames) == 39
    assert source.n_late_discards == 3
    assert source.n_unused == 1  # that of scan 30, which had gone out


def test_codes_become_readings_and_strangers_are_counted() -> None:
    """A code that nobody knows is garbled; what is over the range has a stamp; a leg that is not there has no row."""
    clock = VirtualClock()
    port = Script(clock)
    source = McuSource(port, clock, serial(("rm",)))
    values = [NO_VALUE_BASE + code for code in (0, 1, 2, 3, 4, 6, 7, 15)] + [-1_000_000]
    # The first came when nobody listened yet.
    port.due = [(MS, line(5, 0)), (60 * MS, line(3, 12) + line(5, 12, values))]
    frame = source.read()
    assert frame.reading[0].tolist() == [7, 1, 2, 3, 4, 6, 7, 7, 0]
    assert np.isnan(frame.capacitance_pf[0, :8]).all()
    assert frame.capacitance_pf[0, 8] == pytest.approx(-1.0)
    assert (frame.t_ns[0] > 0).tolist() == [False, False, False, True, False, False, False, False, True]
    assert source.losses["unused"] == 1


def test_half_a_record_before_the_line_was_opened_again_is_no_loss() -> None:
    """It is not joined to what comes after, and nothing wrong is counted."""
    clock = VirtualClock()
    port = Script(clock)
    source = McuSource(port, clock, serial(("lf",)))
    port.due = [((n + 10) * PERIOD_NS + MS, line(1, n)) for n in range(1, 6)]
    port.due.append((16 * PERIOD_NS + MS, line(1, 6)[:30]))
    while clock.now_ns() < 15 * PERIOD_NS:
        source.read()
    while port.due:
        source.read()
    port.n_opened += 1
    start = clock.now_ns() // PERIOD_NS + 1
    port.due = [((start + n) * PERIOD_NS + MS, line(1, start - 10 + n)) for n in range(5)]
    readings = [int(source.read().reading[0, 0]) for _ in range(5)]
    assert readings[-1] == Reading.OK
    losses = {kind: n for kind, n in source.losses.items() if n}
    assert losses.keys() <= {"lost"}


@pytest.mark.parametrize(("first", "faulty_us"), [(1, 700), (1, 60_000), (2, 60_000)])
def test_steps_that_would_end_in_the_future_are_garbled(first: int, faulty_us: int) -> None:
    """The leg has no reading then, and the stamps of the other are not moved by it, whichever record comes first."""
    clock = VirtualClock()
    port = Script(clock)
    source = McuSource(port, clock, serial(("lf", "lm"), baud=10**13))
    steps_us = {n: faulty_us if n == 15 else 0 for n in range(1, 40)}
    port.due = [
        (
            (n + 10) * PERIOD_NS + MS,
            b"".join(line(leg, n, step_us=steps_us[n] if leg == 2 else 0) for leg in (first, 3 - first)),
        )
        for n in range(1, 40)
    ]
    while clock.now_ns() < 49 * PERIOD_NS:
        frame = source.read()
        scan = (clock.now_ns() - MS) // PERIOD_NS - 10
        assert (frame.t_ns <= clock.now_ns()).all()
        assert not frame.reading[0].any()
        assert frame.t_ns[0].tolist() == [(scan + 10) * PERIOD_NS + MS] * 9
        assert (frame.reading[1] == (Reading.CORRUPT if scan == 15 else Reading.OK)).all()


#: From one conversion of a ring to the next; there are 6.4 in a scan.
RING_STEP_US = 781


def ring_scan(number: int) -> bytes:
    """Return the last nine conversions of a ring, sent 3 ms behind the last of them, with the time of sending."""
    last = (5000 * number - 3000) // RING_STEP_US
    first = last - 8
    values = [
        5_000_000 + 1000 * max(n for n in range(first, last + 1) if n % 9 == element) for element in range(9)
    ]
    flags = RecordFlag(first % 9 << 4)
    record = Record(1, number, flags, RING_STEP_US, first * RING_STEP_US % 2**32, pack_values(values))
    return encode_sending(Sending(5000 * number, "a ring" if number == 3 else "")) + encode_record(record)


def test_of_a_ring_each_conversion_has_one_time_however_late_it_is_sent(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The place at which a record begins, and when it was sent, tell the time; one that comes again has the same."""
    caplog.set_level("INFO")
    clock = VirtualClock()
    port = Script(clock)
    source = McuSource(port, clock, serial(("lf",)))
    way_ns = [round(bits * S / BAUD) for bits in (SENDING_BITS, SENDING_BITS + RECORD_BITS)]
    for number in range(1, 60):
        scan = ring_scan(number)
        begin_ns = (number + 10) * PERIOD_NS
        port.due += [(begin_ns + way_ns[0], scan[:-FRAME_BYTES]), (begin_ns + way_ns[1], scan[-FRAME_BYTES:])]
    times: dict[int, set[int]] = {}
    source.read()  # of the first frame on the line nobody knows whether it is whole
    while clock.now_ns() < 68 * PERIOD_NS:
        frame = source.read()
        assert not frame.reading.any()
        for t_ns, pf in zip(frame.t_ns[0], frame.capacitance_pf[0], strict=True):
            times.setdefault(round((pf - 5.0) * 1000), set()).add(int(t_ns))
    assert len(times) > 300
    for n, stamps in times.items():
        (t_ns,) = stamps
        assert t_ns == pytest.approx(10 * PERIOD_NS + 1000 * n * RING_STEP_US, abs=12_000)
    assert port.written == IDENTIFY
    assert [record.message for record in caplog.records if record.levelname == "INFO"] == [
        "microcontroller: a ring"
    ]


def test_a_firmware_of_another_version_has_one_line_with_its_remedy(caplog: pytest.LogCaptureFixture) -> None:
    clock = VirtualClock()
    port = Script(clock)
    source = McuSource(port, clock, serial(("lf",)))

    def of_version_2(number: int) -> bytes:
        body = unstuff(line(1, number)[:-1])
        assert body
        body = b"\2" + body[1:-2]
        return stuff(body + crc_hqx(body, 0xFFFF).to_bytes(2, "little")) + b"\0"

    port.due = [((n + 10) * PERIOD_NS, of_version_2(n)) for n in range(1, 5000)]
    while port.due:
        assert (source.read().reading == Reading.NO_ANSWER).all()
    line_of_version = (
        "the microcontroller sends records of version 2, or with fields that version has not; this footsense reads "
        "version 1: flash the firmware of this footsense (firmware_interface/mcu)"
    )
    assert [record.message for record in caplog.records if record.levelname == "ERROR"] == [line_of_version]
