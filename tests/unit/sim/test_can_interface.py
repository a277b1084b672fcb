"""The simulated CAN interface: the figures that its model has to give."""

import errno

import pytest

from firmware_interface.can.socketcan import ErrorClass, is_error, pack_frame, unpack_frame
from footsense.sim.can.controller import CanSettings
from footsense.sim.can.interface import AS_DEPLOYED, SimulatedCan
from footsense.sim.faults.scene_faults import CanBusOff, CanDown, CanFault, CanNoAck, CanTraffic
from tests.support.can_robot import MS, FakeClock

FRAME_NS = 270_000  # 135 bits at 500 kbit/s
SCAN = [pack_frame(0x109 + n, bytes(8)) for n in range(12)]
PLAIN = CanSettings(queue_frames=10, head_drop=False, one_shot=False, restart_ns=100 * MS)


class Bench:
    """An interface, a socket on it, and what was heard of it."""

    def __init__(self, *faults: CanFault, settings: CanSettings = PLAIN) -> None:
        self.clock = FakeClock()
        self.can = SimulatedCan(self.clock, 2000.0, faults, settings)
        self.wire = self.can.connect()
        self.heard: list[tuple[int, int]] = []  # when, id
        self.can.controller.on_delivered = lambda t_ns, _, frame: self.heard.append(
            (t_ns, unpack_frame(frame)[0])
        )

    def wait_until(self, t_ns: int) -> list[int]:
        """Let time pass, and return the classes of the error frames that came."""
        self.clock.t_ns = t_ns
        ids = [unpack_frame(frame)[0] for frame in self.wire.receive()]
        return [can_id & 0x7FF for can_id in ids if is_error(can_id)]


def test_frames_take_their_bits_one_after_the_other() -> None:
    """Each of eight bytes 0.27 ms, in the order in which they were handed over."""
    bench = Bench()
    bench.wire.send(SCAN, 0)
    bench.wait_until(MS * 100)
    assert bench.heard == [((n + 1) * FRAME_NS, 0x109 + n) for n in range(12)]


def test_a_full_queue_refuses_the_newest_or_drops_the_oldest() -> None:
    """Three frames are in the controller; the queue holds ten, and with head drop the newest of all."""
    bench = Bench()
    assert [bench.wire.send(SCAN, 0), bench.wire.send(SCAN, 0)] == [12, 1]
    bench = Bench(settings=PLAIN._replace(head_drop=True))
    assert [bench.wire.send(SCAN, 0), bench.wire.send(SCAN, 0)] == [12, 12]
    bench.wait_until(MS * 100)
    assert [can_id - 0x109 for _, can_id in bench.heard] == [0, 1, 2, *range(2, 12)]


def test_a_frame_that_nobody_acknowledges_is_sent_until_somebody_does_or_once() -> None:
    """For ever, and with it what waits behind it; in one-shot mode it is gone, and so are those behind it."""
    fault = CanNoAck(at_s=0.0, until_s=1.0)
    bench = Bench(fault)
    bench.wire.send(SCAN, 0)
    errors = bench.wait_until(999 * MS)
    assert (bench.heard, errors) == ([], [ErrorClass.CONTROLLER])
    assert bench.wait_until(1100 * MS) == [ErrorClass.CONTROLLER]  # active again: each delivery takes one off
    assert len(bench.heard) == 12
    bench = Bench(fault, settings=PLAIN._replace(one_shot=True))
    bench.wire.send(SCAN, 0)
    bench.wait_until(1100 * MS)
    assert (bench.heard, bench.can.controller.n_lost) == ([], 12)


def test_one_shot_gives_up_a_frame_for_each_arbitration_that_it_loses() -> None:
    """Against a higher priority; a lower one waits."""
    for can_id, n_heard in ((0x100, 9), (0x7F0, 12)):
        traffic = CanTraffic(at_s=0.0001, until_s=0.0031, can_id=can_id, rate_hz=1000.0)
        bench = Bench(traffic, settings=PLAIN._replace(one_shot=True))
        bench.wire.send(SCAN, 0)
        bench.wait_until(MS * 100)
        assert len(bench.heard) == n_heard


def test_bus_off_after_32_errors_and_back_after_the_restart() -> None:
    """Error passive after 16; the controller's frames are flushed, and what the kernel has emptied does not come."""
    bench = Bench(CanBusOff(at_s=0.0, until_s=0.05))
    bench.wire.send(SCAN, 0)
    errors = bench.wait_until(50 * MS)
    assert errors == [ErrorClass.CONTROLLER, ErrorClass.BUS_OFF]
    assert (bench.can.queue.n_purged, len(bench.can.queue.frames)) == (9, 0)
    assert bench.wait_until(104 * MS) == [ErrorClass.RESTARTED]
    assert bench.can.controller.n_flushed == 3
    bench.wire.send(SCAN, 0)
    bench.wait_until(200 * MS)
    assert len(bench.heard) == 12


def test_each_delivery_takes_one_off_the_errors_that_count_eight() -> None:
    """Eleven failures and 36 deliveries leave 52, so that eleven failures more make it passive for a moment."""
    failure_s = 18 * 2e-6
    shorts = [CanBusOff(at_s=at_s, until_s=at_s + 10.5 * failure_s) for at_s in (0.0, 0.1)]
    bench = Bench(*shorts, settings=PLAIN._replace(queue_frames=40))
    errors = []
    for at_ms in (0, 100, 200):
        errors.append(bench.wait_until(at_ms * MS))
        bench.wire.send(SCAN * 3, 0)
    assert errors == [[], [], [ErrorClass.CONTROLLER, ErrorClass.CONTROLLER]]


def test_without_a_restart_bus_off_is_for_good() -> None:
    """As Linux has it by default."""
    bench = Bench(CanBusOff(at_s=0.0, until_s=0.05), settings=PLAIN._replace(restart_ns=0))
    bench.wire.send(SCAN, 0)
    bench.wait_until(1000 * MS)
    bench.wire.send(SCAN, 0)
    bench.wait_until(100_000 * MS)
    assert bench.heard == []


@pytest.mark.parametrize(("unplugged", "code"), [(False, 0), (True, errno.ENXIO)])
def test_down_empties_everything_and_is_told_once(*, unplugged: bool, code: int) -> None:
    """A socket works again when the interface is up again, but not on an adapter that is a new one."""
    bench = Bench(CanDown(at_s=0.001, until_s=0.1, unplugged=unplugged), settings=AS_DEPLOYED)
    bench.wire.send(SCAN, 0)
    with pytest.raises(OSError, match="Network is down"):
        bench.wait_until(50 * MS)
    assert bench.wait_until(51 * MS) == []
    with pytest.raises(OSError):
        bench.wire.send(SCAN, 0)
    bench.wait_until(150 * MS)
    assert len(bench.heard) == 3
    wire = bench.can.connect()
    assert wire.send(SCAN, 0) == 12
    if code:
        with pytest.raises(OSError, match="No such device"):
            bench.wire.send(SCAN, 0)
    else:
        assert bench.wire.send(SCAN, 0) == 12
