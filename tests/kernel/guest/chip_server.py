"""Answers the transfers of the kernel's adapters (/dev/feet-adapter) with the simulated chips, in real time.

Both boards are there, and a configuration uses one: an AD7147 for each foot, three on each adapter; and on the first
adapter six feet with an FDC1004 behind a multiplexer. A transfer takes its time on the wire.

Commands, one a line, come on a virtio port; each is answered with one line:

    press LEG NEWTON            one foot is pressed from now on: (0.05, 0, NEWTON) N
    lift                        all feet are in the air from now on
    fail LEG|mux|i2c-N ERROR    every transfer to the leg's AD7147, to the multiplexer, or on an adapter fails with this
                                errno; SILENT: nothing answers
    hold LEG [mux]              the leg holds SDA low, behind the multiplexer while its channel is connected: nothing on
                                the bus answers
    dip                         a dip of the supply resets all AD7147
    clear                       neither fails nor holds
    time                        CLOCK_MONOTONIC and CLOCK_REALTIME [s]
    count                       transfers and RESET pulses since the start
"""

import errno
import os
import socket
import struct
import sys
import threading
import time
from collections.abc import Iterable
from functools import partial

import numpy as np

from firmware_interface.chips import ad7147
from footsense.daemon.foot_types import released_path
from footsense.errors import I2cError
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import ELEMENTS, LEGS
from footsense.ports import Transaction
from footsense.sim.chips.ad7147 import SimulatedAd7147
from footsense.sim.clock import VirtualClock
from footsense.sim.i2c_bus import SimulatedBus
from footsense.sim.loads.ground_load import IN_THE_AIR, GroundContact, RampContact
from footsense.sim.robot import BusWiring, SimulatedRobot
from footsense.sim.scene import Ad7147Effects, load_scene

#: Address of the AD7147 of each leg, by the number of its adapter.
ADAPTERS = {
    1: dict(zip(("lf", "lm", "lr"), ad7147.ADDRESSES, strict=False)),
    3: dict(zip(("rf", "rm", "rr"), ad7147.ADDRESSES, strict=False)),
}
MUX_ADAPTER, MUX_ADDRESS = 1, 0x71
_BUS_HZ = 400_000
#: Capacitance of the reference of an AD7147 [pF].
_REFERENCE_PF = 4.7

_REQUEST = struct.Struct("=IIII")
_MESSAGE = struct.Struct("=HHHH")
_ANSWER = struct.Struct("=Iiq")
_READ = 1  # I2C_M_RD
_REQUEST_BYTES = 4096


class RealClock(VirtualClock):
    """CLOCK_MONOTONIC in place of the virtual time of buses, for one transfer at a time.

    Attributes:
        ends_ns: When the transfer ends [ns]: the kernel waits.
    """

    ends_ns = 0

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def sleep_until_ns(self, t_ns: int) -> None:
        self.ends_ns = t_ns


class Steady:
    """A load that does not change, which takes no time to simulate."""

    def __init__(self, contact: GroundContact) -> None:
        self._contact = contact

    def contact(self, leg: str, t_ns: int) -> GroundContact:
        del leg, t_ns
        return self._contact


class ChipServer:
    """The chips of the feet, and what is broken about them."""

    def __init__(self) -> None:
        response = FootResponse.load(released_path("response.npz"))
        behind_mux = BusWiring(_BUS_HZ, MUX_ADDRESS, {leg: channel for channel, leg in enumerate(LEGS)})
        self._clock = RealClock()
        self._behind_mux = SimulatedRobot(load_scene("hanging"), response, [behind_mux])
        (self._mux_bus,) = self._behind_mux.buses
        self._mux_bus.clock = self._clock
        assert self._mux_bus.mux is not None
        self._mux = self._mux_bus.mux
        self._foot = Specimen(response)
        self._element_pf: dict[str, list[float]] = {}
        self._load(LEGS, IN_THE_AIR)
        self._converters = {
            leg: SimulatedAd7147(
                partial(self._input_pf, leg),
                np.random.default_rng(LEGS.index(leg)),
                address=address,
                effects=Ad7147Effects(coherent_bursts=True),
            )
            for addresses in ADAPTERS.values()
            for leg, address in addresses.items()
        }
        self._buses = {
            adapter: SimulatedBus(self._clock, _BUS_HZ, 0, None, {0: [self._converters[leg] for leg in legs]})
            for adapter, legs in ADAPTERS.items()
        }
        self._fails: dict[str, int | None] = {}
        self._holding: set[str] = set()
        self._reset_pulses = 0
        self._n_transfers = 0

    def _input_pf(
        self, leg: str, cin: int, connections: tuple[ad7147.InputConnection, ...], from_ns: int, to_ns: int
    ) -> float:
        del connections, from_ns, to_ns
        return self._element_pf[leg][cin] if cin < ELEMENTS else _REFERENCE_PF

    def _load(self, legs: Iterable[str], contact: GroundContact) -> None:
        pf = self._foot.capacitance_pf(contact.normal[None], contact.force_n[None])[0].tolist()
        for leg in legs:
            self._element_pf[leg] = pf
            self._behind_mux.legs[leg]._load = Steady(contact)

    def serve(self) -> None:
        """Answer transfers until the adapters' module goes."""
        device = os.open("/dev/feet-adapter", os.O_RDWR)
        while True:
            request = os.read(device, _REQUEST_BYTES)
            serial, adapter, reset_pulses, n_messages = _REQUEST.unpack_from(request)
            if reset_pulses != self._reset_pulses:
                self._reset_pulses = reset_pulses
                self._mux.pulse()
            at = _REQUEST.size + n_messages * _MESSAGE.size
            messages = list(_MESSAGE.iter_unpack(request[_REQUEST.size : at]))
            n_read = sum(length for _, flags, length, _ in messages if flags & _READ)
            self._clock.ends_ns = 0
            answer = self._transfer(adapter, Transaction(messages[0][0], request[at:], n_read))
            self._n_transfers += 1
            if isinstance(answer, bytes):
                os.write(device, _ANSWER.pack(serial, n_messages, self._clock.ends_ns) + answer)
            elif answer is not None:
                os.write(device, _ANSWER.pack(serial, -answer, self._clock.ends_ns))

    def _transfer(self, adapter: int, transaction: Transaction) -> bytes | int | None:
        """Return the bytes read, or an errno; None for no answer at all."""
        address, addresses, bus = transaction.address, ADAPTERS[adapter], self._buses[adapter]
        reached = [leg for leg, own in addresses.items() if own == address]
        holding = self._holding & {*addresses}
        if adapter == MUX_ADAPTER:
            holding |= {
                f"{leg} mux" for channel, leg in enumerate(LEGS) if self._mux.control >> channel & 1
            } & self._holding
            if address not in ad7147.ADDRESSES:
                bus, reached = self._mux_bus, ["mux"] if address == MUX_ADDRESS else []
        if holding:
            return None
        for target in (f"i2c-{adapter}", *reached):
            if target in self._fails:
                return self._fails[target]
        try:
            return bus.transfer(transaction)
        except I2cError:
            return errno.ENXIO

    def obey(self, command: str) -> str:
        """Execute a command and return its answer."""
        match command.split(maxsplit=2):
            case ["press", leg, newton]:
                self._load((leg,), RampContact((0.05, 0.0, float(newton)), 0).contact(leg, 0))
            case ["lift"]:
                self._load(LEGS, IN_THE_AIR)
            case ["fail", target, error]:
                self._fails[target] = None if error == "SILENT" else getattr(errno, error)
            case ["hold", *leg]:
                self._holding.add(" ".join(leg))
            case ["dip"]:
                for converter in self._converters.values():
                    converter.brown_outs_ns.append(self._clock.now_ns())
            case ["clear"]:
                self._fails.clear()
                self._holding.clear()
            case ["time"]:
                return f"{time.monotonic()} {time.time()}"
            case ["count"]:
                return f"{self._n_transfers} {self._reset_pulses}"
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
