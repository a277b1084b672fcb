"""Answers the transfers of the kernel's adapter (/dev/feet-adapter) with the simulated chips, in real time.

Commands, one a line, come on a virtio port; each is answered with one line:

    press LEG NEWTON            one foot is pressed from now on: (0.05, 0, NEWTON) N
    lift                        all feet are in the air from now on
    fail LEG|all|mux ERROR      every transfer to it alone fails with this errno; SILENT: none answers
    hold LEG                    the leg holds SDA low while its channel is connected: nothing on the bus answers
    clear                       neither fails nor holds
    mux ADDRESS                 strap of the multiplexer
    time                        CLOCK_MONOTONIC and CLOCK_REALTIME [s]
    count                       transfers, RESET pulses and the multiplexer's register since the start
"""

import errno
import os
import socket
import struct
import sys
import threading
import time
from pathlib import Path

from footsense.daemon.foot_types import released_path
from footsense.errors import I2cError
from footsense.foot.response_table import FootResponse
from footsense.frames import LEGS
from footsense.ports import Transaction
from footsense.sim.clock import VirtualClock
from footsense.sim.loads.ground_load import IN_THE_AIR, GroundContact, RampContact
from footsense.sim.robot import BusWiring, SimulatedRobot
from footsense.sim.scene import load_scene

DEVICE = Path("/dev/feet-adapter")

_REQUEST = struct.Struct("=III")
_MESSAGE = struct.Struct("=HHHH")
_ANSWER = struct.Struct("=Ii")
_READ = 1  # I2C_M_RD
_NOBODY = 0x7F  # the address with which footsense gives nine clocks
_REQUEST_BYTES = 4096


class RealClock(VirtualClock):
    """Real time in place of a bus's virtual one: a transaction takes the time that it takes."""

    def __init__(self) -> None:
        super().__init__()
        self._start_ns = time.monotonic_ns()

    def now_ns(self) -> int:
        return time.monotonic_ns() - self._start_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        del t_ns


class InTheAir:
    """No load."""

    def contact(self, leg: str, t_ns: int) -> GroundContact:
        del leg, t_ns
        return IN_THE_AIR


class ChipServer:
    """The chips of six feet behind one multiplexer, and what is broken about them."""

    def __init__(self) -> None:
        response = FootResponse.load(released_path("response.npz"))
        wiring = BusWiring(400_000, 0x71, {leg: channel for channel, leg in enumerate(LEGS)})
        self._robot = SimulatedRobot(load_scene("hanging"), response, [wiring])
        (self._bus,) = self._robot.buses
        self._clock = RealClock()
        self._bus.clock = self._clock
        assert self._bus.mux is not None
        self._mux = self._bus.mux
        self._fails: dict[str, int | None] = {}
        self._holding: set[int] = set()
        self._reset_pulses = 0
        self._n_transfers = 0

    def serve(self) -> None:
        """Answer transfers until the adapter's module goes."""
        device = os.open(DEVICE, os.O_RDWR)
        while True:
            request = os.read(device, _REQUEST_BYTES)
            serial, reset_pulses, n_messages = _REQUEST.unpack_from(request)
            if reset_pulses != self._reset_pulses:
                self._reset_pulses = reset_pulses
                self._mux.pulse()
            at = _REQUEST.size + n_messages * _MESSAGE.size
            messages = list(_MESSAGE.iter_unpack(request[_REQUEST.size : at]))
            n_read = sum(length for _, flags, length, _ in messages if flags & _READ)
            answer = self._transfer(messages[0][0], request[at:], n_read)
            self._n_transfers += 1
            if isinstance(answer, bytes):
                os.write(device, _ANSWER.pack(serial, n_messages) + answer)
            elif answer is not None:
                os.write(device, _ANSWER.pack(serial, -answer))

    def _transfer(self, address: int, written: bytes, n_read: int) -> bytes | int | None:
        """Return the bytes read, or an errno; None for no answer at all."""
        connected = [leg for channel, leg in enumerate(LEGS) if self._mux.control >> channel & 1]
        if any(LEGS.index(leg) in self._holding for leg in connected):
            return None
        reached = ["mux"] if address == self._mux.address else connected
        for target in ("all", *reached):
            # Of several connected legs the others acknowledge in its place.
            if target in self._fails and (target == "all" or (len(reached) == 1 and address != _NOBODY)):
                return self._fails[target]
        try:
            if written or n_read:
                return self._bus.transfer(Transaction(address, written, n_read))
            answering = [
                c
                for c in self._bus._connected_chips(self._mux.control, address)
                if c.acknowledges(self._clock.now_ns())
            ]
        except I2cError:
            return errno.ENXIO
        return b"" if answering else errno.ENXIO

    def obey(self, command: str) -> str:
        """Execute a command and return its answer."""
        match command.split():
            case ["press", leg, newton]:
                self._robot.legs[leg]._load = RampContact((0.05, 0.0, float(newton)), self._clock.now_ns())
            case ["lift"]:
                for simulated in self._robot.legs.values():
                    simulated._load = InTheAir()
            case ["fail", target, error]:
                self._fails[target] = None if error == "SILENT" else getattr(errno, error)
            case ["hold", leg]:
                self._holding.add(LEGS.index(leg))
            case ["clear"]:
                self._fails.clear()
                self._holding.clear()
            case ["mux", address]:
                self._mux.address = int(address, 0)
                self._bus._connected.clear()
            case ["time"]:
                return f"{time.monotonic()} {time.time()}"
            case ["count"]:
                return f"{self._n_transfers} {self._reset_pulses} {self._mux.control:#04x}"
            case _:
                return f"unknown command: {command}"
        return f"done {time.time()}"


def listen(server: ChipServer, port_name: str) -> None:
    """Execute the commands of a virtio port."""
    with open(port_name, "r+b", buffering=0) as port:  # noqa: PTH123
        rest = b""
        while True:
            read = port.read(4096)
            if not read:
                time.sleep(0.2)
                continue
            *lines, rest = (rest + read).split(b"\n")
            for line in lines:
                try:
                    answer = server.obey(line.decode())
                except (KeyError, ValueError, AttributeError) as error:
                    answer = repr(error)
                port.write(answer.encode() + b"\n")


def main() -> None:
    """Serve chips and commands."""
    server = ChipServer()
    threading.Thread(target=listen, args=(server, sys.argv[1]), daemon=True).start()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.sendto(b"READY=1", os.environ["NOTIFY_SOCKET"])
    server.serve()


if __name__ == "__main__":
    main()
