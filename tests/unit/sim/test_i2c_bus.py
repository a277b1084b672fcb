"""The simulated trunk is an open-drain bus with a mux that switches on STOP, and it takes real time."""

import pytest

from footsense.errors import NackError
from footsense.ports import Transaction
from footsense.sim.chips.chip import SimulatedLineSwitch, SimulatedMux
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.clock import JoinedClock, VirtualClock
from footsense.sim.i2c_bus import SimulatedBus

MUX = 0x71
SWITCH = 0x49


class Legs:
    """Three legs with row switches on channels 0 to 2."""

    def __init__(self, host_cost_ns: int = 0) -> None:
        self.clock = VirtualClock()
        self.switches = [SimulatedLineSwitch() for _ in range(3)]
        self.bus = SimulatedBus(
            self.clock,
            400_000,
            host_cost_ns,
            SimulatedMux(MUX),
            {n: (s,) for n, s in enumerate(self.switches)},
        )

    def write(self, address: int, value: int) -> None:
        self.bus.transfer(Transaction(address, bytes((value,))))


def test_answers_to_a_broadcast_read_are_a_wired_and() -> None:
    """One converter that has finished and one that has not read together as one that has not."""
    clock = VirtualClock()
    converters = [SimulatedFdc1004(lambda cin, t_start, t_end: 5.0, None) for _ in range(2)]
    bus = SimulatedBus(clock, 400_000, 0, SimulatedMux(MUX), {n: (c,) for n, c in enumerate(converters)})
    read_conf = Transaction(0x50, b"\x0c", 2)
    trigger = Transaction(0x50, b"\x0c\x0c\x80")
    for channels in (0b11, 0b10):  # the second trigger restarts the second converter alone
        bus.transfer(Transaction(MUX, bytes((channels,))))
        bus.transfer(trigger)
        clock.advance_ns(1_500_000)
    answers = []
    for channels in (0b01, 0b10, 0b11):
        bus.transfer(Transaction(MUX, bytes((channels,))))
        answers.append(bus.transfer(read_conf).hex())
    assert answers == ["0c88", "0c80", "0c80"]


def test_a_missing_leg_cannot_be_seen_in_a_broadcast() -> None:
    """The others acknowledge for it; alone, it is found out."""
    legs = Legs()
    legs.switches[1].absent_ns = [(0, 1e18)]
    legs.write(MUX, 0b111)
    legs.write(SWITCH, 0x31)
    legs.write(MUX, 0b010)
    with pytest.raises(NackError):
        legs.write(SWITCH, 0x31)


def test_every_transaction_takes_its_bits_and_the_host_s_cost() -> None:
    """20 bits at 400 kHz are 50 us, tBUF 1.3 us, the host 100 us; an unanswered address ends after 11 bits."""
    legs = Legs(host_cost_ns=100_000)
    legs.write(MUX, 1)
    assert legs.clock.now_ns() == 100_000 + 50_000 + 1_300
    legs = Legs()
    with pytest.raises(NackError):
        legs.write(SWITCH, 1)
    assert legs.clock.now_ns() == 27_500 + 1_300


def test_buses_run_side_by_side_until_someone_needs_them_all() -> None:
    """Each bus has its own time; the joined clock stands at the latest and takes the others along."""
    first, second = VirtualClock(), VirtualClock()
    first.advance_ns(500)
    second.advance_ns(300)
    assert JoinedClock([first, second]).now_ns() == 500
    assert second.now_ns() == 500
    first.advance_ns(2000)
    assert JoinedClock([first, second], grace_ns=1000).now_ns() == 500
    assert (first.now_ns(), second.now_ns()) == (2500, 500)
