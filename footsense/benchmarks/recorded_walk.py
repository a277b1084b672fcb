"""A simulated walk as its I2C transactions, which the service's own adapter class then reads without a simulator.

A simulated chip takes as many instructions as the scanner that reads it, so the walk is simulated before anything is
counted. Six legs walk and are tared; then one leg is unplugged, another has an open element, a third loses
acknowledges, and a fourth is beside a motor. What stands for the kernel is counted apart, and left out.
"""

import ctypes
import errno
import os
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import smbus2
from msgspec import Struct
from msgspec.structs import replace

from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.linux_i2c import LinuxI2cBus
from footsense.acquisition.robot_scanner import RobotScanner
from footsense.config import DEFAULT, Config
from footsense.daemon.acquisition import bus_scanners
from footsense.daemon.simulation import simulated_robot
from footsense.errors import I2cError, I2cTimeoutError, NackError
from footsense.ports import I2cBus, Transaction
from footsense.sim.clock import JoinedClock, VirtualClock
from footsense.sim.faults.scene_faults import Absent, ElementOpen, NackAtRandom, WhiteNoise
from footsense.sim.scene import load_scene

#: The robot that walks.
ROBOT = DEFAULT
#: Time in the air, in which the feet are tared [s].
_LEAD_IN_S = 0.25
#: Begin of the faults [s]: shortly after three feet have touched the ground beside the three others.
_BREAKS_AT_S = 0.87
_FAULTS = (
    Absent(leg="rm", at_s=_BREAKS_AT_S),
    ElementOpen(leg="lf", element=4, at_s=_BREAKS_AT_S),
    NackAtRandom(leg="lr", rate_rel=0.02, at_s=_BREAKS_AT_S),
    WhiteNoise(legs=("rf",), noise_ff=20.0, at_s=_BREAKS_AT_S),
)
#: Cycles that are recorded and not run.
_N_SPARE_CYCLES = 4
#: More than any answer of a chip.
_MAX_ANSWER_BYTES = 32
#: What the kernel answers for the errors of a transaction; for others EIO.
_ERRNO_OF_ERROR: dict[type[I2cError], int] = {
    NackError: errno.EREMOTEIO,
    I2cTimeoutError: errno.ETIMEDOUT,
}


class Exchange(NamedTuple):
    """One transaction of a bus.

    Attributes:
        answer: The bytes read.
        errno: Error number of the kernel, 0 for none.
        t_ns: Time of the bus when it is over [ns].
    """

    answer: bytes
    errno: int
    t_ns: int


class RecordedWalk(Struct, frozen=True):
    """The transactions of a walk, its start included.

    Attributes:
        buses: Transactions of each bus.
        n_warm_up: Cycles before those that count.
        n_healthy: Cycles of walking without faults that follow.
        n_faulty: Cycles with faults that follow; a few more are recorded.
        n_transactions: Transactions of each of these cycles.
        cycle_ns: Mean time of a healthy cycle [ns].
        end_ns: Time of the loop after the last of these cycles [ns].
    """

    buses: list[list[Exchange]]
    n_warm_up: int
    n_healthy: int
    n_faulty: int
    n_transactions: list[int]
    cycle_ns: float
    end_ns: int


class _RecordingBus:
    """Adapter that keeps the transactions of another one."""

    def __init__(self, bus: I2cBus, clock: VirtualClock) -> None:
        self._bus, self._clock = bus, clock
        self.exchanges: list[Exchange] = []

    def transfer(self, transaction: Transaction) -> bytes:
        """Do one transaction, and return the bytes read.

        Raises:
            I2cError: It failed.
        """
        try:
            answer = self._bus.transfer(transaction)
        except I2cError as error:
            number = _ERRNO_OF_ERROR.get(type(error), errno.EIO)
            self.exchanges.append(Exchange(b"", number, self._clock.now_ns()))
            raise
        self.exchanges.append(Exchange(answer, 0, self._clock.now_ns()))
        return answer


def record_walk(n_healthy: int, n_faulty: int) -> RecordedWalk:
    """Simulate a walk, and return its transactions.

    Args:
        n_healthy: Cycles to count before the faults.
        n_faulty: Cycles to count with them.
    """
    scene = replace(load_scene("measured_walk"), lead_in_s=_LEAD_IN_S, faults=_FAULTS)
    robot = simulated_robot(ROBOT, scene)
    clocks = [bus.clock for bus in robot.buses]
    buses = [_RecordingBus(bus, bus.clock) for bus in robot.buses]
    scanner, clock = started_scanner(ROBOT, buses, clocks)
    times_ns, n_transactions = [clock.now_ns()], list[int]()

    def read() -> None:
        n_before = sum(len(bus.exchanges) for bus in buses)
        scanner.read()
        times_ns.append(clock.now_ns())
        n_transactions.append(sum(len(bus.exchanges) for bus in buses) - n_before)

    while times_ns[-1] < _BREAKS_AT_S * 1e9:
        read()
    n_warm_up = len(n_transactions) - 1 - n_healthy  # the last one has the first faults
    for _ in range(n_faulty - 1 + _N_SPARE_CYCLES):
        read()
    return RecordedWalk(
        buses=[bus.exchanges for bus in buses],
        n_warm_up=n_warm_up,
        n_healthy=n_healthy,
        n_faulty=n_faulty,
        n_transactions=n_transactions[n_warm_up:-_N_SPARE_CYCLES],
        cycle_ns=(times_ns[n_warm_up + n_healthy] - times_ns[n_warm_up]) / n_healthy,
        end_ns=times_ns[-1 - _N_SPARE_CYCLES],
    )


def started_scanner(
    config: Config, buses: Sequence[I2cBus], clocks: Sequence[VirtualClock]
) -> tuple[RobotScanner, JoinedClock]:
    """Return the started scanner of a robot, which reads its buses in turn, and the clock of its loop."""
    sections = zip(buses, config.buses, strict=True)
    legs = [LegBus(bus, section.mux_address) for bus, section in sections]
    scanner = RobotScanner(bus_scanners(config, list(zip(legs, clocks, strict=True))))
    scanner.start()
    return scanner, JoinedClock(clocks, config.scan_plan.longest_frame_ns)


class ReplayedWalk(NamedTuple):
    """A recorded walk, ready to be read.

    Attributes:
        scanner: The scanner, started.
        clock: Clock of the loop.
        answer: Does what stands for the kernel in a transaction of the first bus, as often as cycles are to spare.
    """

    scanner: RobotScanner
    clock: JoinedClock
    answer: Callable[[], object]


def replay_walk(walk: RecordedWalk) -> ReplayedWalk:
    """Return a recorded walk over the adapter class of Linux.

    The system call of the adapters gets the recorded answers, in place of the kernel's.
    """
    clocks = [VirtualClock() for _ in walk.buses]
    adapters = [smbus2.SMBus() for _ in walk.buses]
    answers: dict[int, tuple[VirtualClock, Iterator[Exchange]]] = {}
    for adapter, clock, exchanges in zip(adapters, clocks, walk.buses, strict=True):
        adapter.fd = os.open(os.devnull, os.O_RDONLY)
        answers[adapter.fd] = clock, iter(exchanges)

    def ioctl(fd: int, _request: int, data: smbus2.smbus2.i2c_rdwr_ioctl_data) -> None:
        clock, exchanges = answers[fd]
        answer, number, t_ns = next(exchanges)
        clock.sleep_until_ns(t_ns)
        if number:
            raise OSError(number, os.strerror(number))
        if answer:
            ctypes.memmove(data.msgs[data.nmsgs - 1].buf, answer, len(answer))

    buses = [LinuxI2cBus(adapter, f"bus {n}", ioctl) for n, adapter in enumerate(adapters)]
    scanner, loop_clock = started_scanner(ROBOT, buses, clocks)
    message = smbus2.i2c_msg.read(0, _MAX_ANSWER_BYTES)
    anything = smbus2.smbus2.i2c_rdwr_ioctl_data.create(message)

    def answer() -> None:
        try:  # noqa: SIM105 - without the cost of a context
            ioctl(adapters[0].fd, 0, anything)
        except OSError:
            pass

    return ReplayedWalk(scanner, loop_clock, answer)
