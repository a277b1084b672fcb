"""Error frames of a controller: counted one by one, and told once for each illness."""

import pytest

from firmware_interface.can.socketcan import (
    CONTROLLER_ACTIVE,
    CONTROLLER_PASSIVE,
    ErrorClass,
    error_frame,
    unpack_frame,
)
from footsense.can.bus_health import BusHealth
from footsense.frames import CanStatistics

S = 1_000_000_000
TX_PASSIVE = 0x20
assert TX_PASSIVE & CONTROLLER_PASSIVE


def note(health: BusHealth, error: ErrorClass, t_ns: int, detail: int = 0) -> None:
    health.count_error_frame(*unpack_frame(error_frame(error, detail)), t_ns)


def test_every_error_frame_counts_as_what_it_is() -> None:
    """Restarts and returns to error active are errors of the bus, and nothing else."""
    stats = CanStatistics()
    health = BusHealth("can0", stats)
    for n in range(3):
        note(health, ErrorClass.CONTROLLER, n * S, TX_PASSIVE)
        note(health, ErrorClass.CONTROLLER, n * S, CONTROLLER_ACTIVE)
        note(health, ErrorClass.BUS_OFF, n * S)
        note(health, ErrorClass.BUS_OFF, n * S)
        note(health, ErrorClass.RESTARTED, n * S)
    assert (stats.bus_errors, stats.error_passive, stats.bus_off) == (15, 3, 6)


def test_each_illness_is_told_with_its_own_number_of_bus_offs(caplog: pytest.LogCaptureFixture) -> None:
    """The second as the first; what is no illness is not told."""
    health = BusHealth("can0", CanStatistics())
    note(health, ErrorClass.CONTROLLER, 0, CONTROLLER_ACTIVE)
    note(health, ErrorClass.RESTARTED, 0)
    health.check_recovery(100 * S)
    assert caplog.records == []
    for begin_ns, n_bus_off in ((100 * S, 3), (200 * S, 2)):
        note(health, ErrorClass.CONTROLLER, begin_ns, TX_PASSIVE)
        for n in range(n_bus_off):
            note(health, ErrorClass.BUS_OFF, begin_ns + n)
        health.check_recovery(begin_ns + 99 * S)
        health.check_recovery(begin_ns + 99 * S)
    lines = [record.getMessage() for record in caplog.records]
    off = "CAN can0: bus-off: the wires are shorted, or the bit rates differ; frames are lost until the controller "
    assert lines[::3] == ["CAN can0: error passive: nobody acknowledges, or the wires are bad"] * 2
    assert lines[1::3] == [off + "restarts"] * 2
    assert lines[2::3] == [f"CAN can0: no more errors; bus-off {n} times until then" for n in (3, 2)]


def test_a_bus_that_is_off_at_once_is_told_with_every_bus_off(caplog: pytest.LogCaptureFixture) -> None:
    """Shorted wires: no error before it; those of an illness before do not count."""
    health = BusHealth("can0", CanStatistics())
    for begin_ns, n_bus_off in ((100 * S, 3), (200 * S, 1)):
        for n in range(n_bus_off):
            note(health, ErrorClass.BUS_OFF, begin_ns + n)
        health.check_recovery(begin_ns + 99 * S)
    told = [record.getMessage() for record in caplog.records][1::2]
    assert told == [f"CAN can0: no more errors; bus-off {n} times until then" for n in (3, 1)]


def test_a_queue_that_is_full_now_and_then_is_told_once_and_at_its_end(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Half of the frames dropped for ten seconds are two lines, the second with their number; again, two more."""
    stats = CanStatistics()
    health = BusHealth("can0", stats)
    for begin_ns, n_frames in ((0, 1000), (100 * S, 500)):
        for n in range(n_frames):
            if n % 2:
                health.log_queue_full(begin_ns + n * 10_000_000)
                stats.dropped += 1
            health.check_recovery(begin_ns + n * 10_000_000)
        health.check_recovery(begin_ns + 50 * S)
    lines = [record.getMessage() for record in caplog.records]
    assert ["its queue is full" in line for line in lines] == [True, False] * 2
    assert lines[1::2] == [
        f"CAN can0: takes all frames again; {n} were dropped until then" for n in (500, 250)
    ]
