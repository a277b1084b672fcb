"""Feet are found on buses of which nothing is known, and the file that is written of them is right."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from footsense.acquisition.linux_i2c import adapter_names
from footsense.can.interface import Can
from footsense.cli.setup.robot_file import found_part, robot_file
from footsense.config import SMALL_BOARD, load_config
from footsense.daemon.setup.found_feet import FoundFeet, find_feet, robot_of
from footsense.daemon.setup.probe import probe
from footsense.errors import ConfigError, HardwareError, NackError
from footsense.ports import Transaction
from footsense.sim.chips.ad7147 import SimulatedAd7147
from footsense.sim.chips.chip import SimulatedChip, SimulatedLineSwitch, SimulatedMux
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.clock import VirtualClock
from footsense.sim.faults import scene_faults
from footsense.sim.faults.chip_faults import inject_chip_faults
from footsense.sim.i2c_bus import SimulatedBus
from footsense.sim.scene import load_scene

RNG = np.random.default_rng(1)
HANGING = load_scene("hanging")
SOCKET = Can(interface="socketcan", channel="can0")


def fdc1004() -> Sequence[SimulatedChip]:
    return SimulatedFdc1004(lambda *_: 5.0, None), SimulatedLineSwitch()


def ad7147(*addresses: int) -> Sequence[SimulatedAd7147]:
    return [SimulatedAd7147(lambda *_: 5.0, None, address=address) for address in addresses]


def found_on(
    mux: int | None, channels: Sequence[int], chips: Callable[[], Sequence[SimulatedChip]]
) -> FoundFeet | None:
    clock = VirtualClock()
    wires = SimulatedBus(
        clock,
        400_000,
        0,
        None if mux is None else SimulatedMux(mux),
        {channel: chips() for channel in channels},
    )
    return find_feet("/dev/i2c-1", wires, clock)


@pytest.mark.parametrize(
    ("mux", "channels", "chips", "board"),
    [
        (0x71, (0, 1, 2, 3, 4, 5), fdc1004, "fdc1004"),
        (0x74, (2, 7), fdc1004, "fdc1004"),
        (None, (0,), fdc1004, "fdc1004"),
        (0x71, (0, 3, 4), lambda: ad7147(0x2C), "ad7147"),
    ],
)
def test_feet_are_found_wherever_they_answer(
    mux: int | None, channels: tuple[int, ...], chips: Callable[[], Sequence[SimulatedChip]], board: str
) -> None:
    """Behind a multiplexer at any address, of either board, or one directly on the adapter."""
    assert found_on(mux, channels, chips) == FoundFeet("/dev/i2c-1", board, mux, channels)


def test_feet_with_an_address_each_are_found_directly_on_an_adapter() -> None:
    """Whatever their straps; a chip that only acknowledges at such an address is no foot."""
    found = found_on(None, (0,), lambda: (*ad7147(0x2C, 0x2F), Repeater(0x2D)))
    assert found == FoundFeet("/dev/i2c-1", "ad7147", None, (0, 0), (0x2C, 0x2F))
    bus = found.bus(("lf", "rf"))
    assert (bus.addresses, bus.legs, bus.mux_address) == ({"lf": 0x2C, "rf": 0x2F}, {}, None)
    three = found_on(None, (0,), lambda: ad7147(0x2C, 0x2D, 0x2F))
    assert three is not None
    assert robot_of([three], (), SOCKET).legs == ("lf", "lm", "lr")


@pytest.mark.parametrize(("mux", "channel"), [(None, 0), (0x71, 3)])
def test_what_is_no_ad7147_is_no_foot_and_is_not_written(mux: int | None, channel: int) -> None:
    """A potentiometer with one register would take a question for a setting."""
    other = Repeater(0x2C)
    assert found_on(mux, (channel,), lambda: (other,)) is None
    assert other.written == []
    eeprom = inject_chip_faults(ad7147(0x2C)[0], None, [scene_faults.WrongChip(at_s=0, leg="lf")], RNG)
    assert found_on(mux, (channel,), lambda: eeprom) is None


class Repeater:
    """A chip with one register, which reads repeat."""

    def __init__(self, address: int) -> None:
        self.address = address
        self.written: list[bytes] = []

    def acknowledges(self, t_ns: int) -> bool:
        return True

    def write(self, data: bytes, t_ns: int) -> None:
        if data:
            self.written.append(data)

    def read(self, n: int, t_ns: int) -> bytes:
        return b"\x80" * n


def test_a_bus_without_feet_has_none() -> None:
    assert found_on(0x71, (), fdc1004) is None
    assert found_on(None, (0,), lambda: (SimulatedLineSwitch(),)) is None


class SlowAdapter:
    """An adapter that needs a second to tell that no chip answers, as some of graphics cards do."""

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock

    def transfer(self, transaction: Transaction) -> bytes:
        self._clock.sleep_until_ns(self._clock.now_ns() + 1_000_000_000)
        raise NackError(f"nobody at {transaction.address:#04x}")


def test_the_search_of_a_slow_adapter_ends_and_says_why() -> None:
    """112 addresses would take two minutes, and those behind a multiplexer a quarter of an hour."""
    clock = VirtualClock()
    with pytest.raises(
        HardwareError,
        match=r"/dev/i2c-1: the scan was given up after 60 s: this adapter does 1\.[01] transactions/s",
    ):
        find_feet("/dev/i2c-1", SlowAdapter(clock), clock)
    assert clock.now_ns() < 65e9


class ServoBoard:
    """A bus with a servo board at 0x70, which would take a selection for a register."""

    def __init__(self) -> None:
        self.written: list[bytes] = []

    def transfer(self, transaction: Transaction) -> bytes:
        if transaction.address == 0x70:
            self.written.append(transaction.write)
            return b"\x11" * transaction.n_read
        raise NackError("nobody")


def test_what_is_no_multiplexer_is_never_switched() -> None:
    """A servo board is asked what it reads back, and no channel is written to it."""
    bus = ServoBoard()
    assert find_feet("/dev/i2c-1", bus, VirtualClock()) is None
    assert set(bus.written) <= {b"", b"\0"}


@pytest.mark.parametrize(
    ("found", "legs"),
    [
        ([(0x71, (0, 1, 2, 3))], "lf lr rf rr"),
        ([(0x71, (0, 1, 2, 4, 5))], "lf lm lr rm rr"),
        ([(0x71, (0, 1, 2)), (0x71, (0, 1, 2))], "lf lm lr rf rm rr"),
        ([(None, (0,)), (None, (0,))], "lf rf"),
    ],
)
def test_legs_have_the_names_that_so_many_have(
    found: list[tuple[int | None, tuple[int, ...]]], legs: str
) -> None:
    """Of six legs of which one does not answer, the others keep their channels' names."""
    feet = [FoundFeet(f"/dev/i2c-{n}", "fdc1004", mux, channels) for n, (mux, channels) in enumerate(found)]
    config = robot_of(feet, (), SOCKET)
    assert config.legs == tuple(legs.split())
    with pytest.raises(ConfigError, match="feet answer, and 1 legs are named: lf"):
        robot_of(feet, ("lf",), SOCKET)


def test_a_file_of_a_real_robot_is_right_and_says_what_was_found(tmp_path: Path) -> None:
    """It is read as the configuration that it was made of; readings are in force only of feet that hang free."""
    bus = replace(SMALL_BOARD.buses[0], device="/dev/i2c-1")
    config = replace(SMALL_BOARD, buses=(replace(bus, mux=type(bus.mux)()),), can=SOCKET)
    found = probe(SMALL_BOARD, HANGING)
    file = tmp_path / "robot.yaml"
    for hang_free in (False, True):
        text = robot_file(config, found, {"/dev/i2c-1": "bcm2835 (i2c@7e804000)"}, hang_free=hang_free)
        file.write_text(text)
        read = load_config(file)
        assert (read.legs, read.buses, read.can) == (config.legs, config.buses, SOCKET)
        assert len(read.unloaded_pf) == 6 * hang_free
        assert max(map(len, text.splitlines())) <= 120
        assert "# bcm2835 (i2c@7e804000)" in text


@pytest.mark.parametrize("device", ["/dev/i2c-{}", "sim{}"])
def test_a_file_of_legs_with_addresses_is_right(tmp_path: Path, device: str) -> None:
    """And so is the part that a probe writes, without a leg that is unplugged."""
    feet = [FoundFeet(device.format(n), "ad7147", None, (0, 0, 0), (0x2C, 0x2D, 0x2F)) for n in range(2)]
    config = robot_of(feet, (), SOCKET)
    assert config.legs == ("lf", "lm", "lr", "rf", "rm", "rr")
    simulated = replace(
        config, buses=tuple(replace(bus, device=f"sim{n}") for n, bus in enumerate(config.buses))
    )
    found = probe(simulated, replace(HANGING, faults=(scene_faults.Absent(at_s=0, leg="lm"),)))
    file = tmp_path / "robot.yaml"
    file.write_text(robot_file(config, found, {}, hang_free=False))
    read = load_config(file)
    assert (read.board, read.buses) == ("ad7147", config.buses)
    file.write_text(found_part(config, found) + "can: {interface: virtual}\n")
    read = load_config(file)
    assert dict(read.buses[0].addresses.items()) == {"lf": 0x2C, "lr": 0x2F}
    assert read.buses[1] == config.buses[1]


def test_the_part_that_a_probe_writes_has_the_legs_that_answer(tmp_path: Path) -> None:
    """Not one that is unplugged."""
    found = probe(SMALL_BOARD, replace(HANGING, faults=(scene_faults.Absent(at_s=0, leg="lm"),)))
    file = tmp_path / "part.yaml"
    file.write_text(found_part(SMALL_BOARD, found) + "can: {interface: virtual}\n")
    read = load_config(file)
    assert read.legs == ("lf", "lr", "rf", "rm", "rr")
    assert set(read.unloaded_pf) == {*read.legs}


def test_adapters_are_listed_by_their_numbers(tmp_path: Path) -> None:
    for number, name in ((11, "i2c-1-mux"), (1, "bcm2835")):
        (tmp_path / f"i2c-{number}").mkdir()
        (tmp_path / f"i2c-{number}/name").write_text(name + "\n")
    assert list(adapter_names(tmp_path).items()) == [("/dev/i2c-1", "bcm2835"), ("/dev/i2c-11", "i2c-1-mux")]
