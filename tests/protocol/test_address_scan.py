"""Which transactions ask an address whether it is there, and what their answers mean."""

import pytest

from footsense.acquisition.bus_scan import probe_addresses
from footsense.errors import I2cError, I2cTimeoutError, NackError
from footsense.ports import Transaction


class Bus:
    """A bus with chips at some addresses; notes what it is asked."""

    def __init__(self, *chips: int, fails: type[I2cError] = NackError) -> None:
        self._chips = chips
        self._fails = fails
        self.asked: list[Transaction] = []

    def transfer(self, transaction: Transaction) -> bytes:
        self.asked.append(transaction)
        if transaction.address not in self._chips:
            raise self._fails("no")
        return bytes(transaction.n_read)


def test_every_address_is_asked_once_and_as_it_can_bear() -> None:
    """EEPROMs and memory modules are read, all others get an empty write; reserved and held addresses get nothing."""
    bus = Bus(0x40, 0x50)
    assert probe_addresses(bus, skipped={0x68}).answering == (0x40, 0x50)
    asked = {transaction.address: transaction for transaction in bus.asked}
    assert len(asked) == len(bus.asked)
    assert sorted(asked) == [address for address in range(0x08, 0x78) if address != 0x68]
    read = {address for address, (_, data, n_read) in asked.items() if (data, n_read) == (b"", 1)}
    assert read == {*range(0x30, 0x38), *range(0x50, 0x60)}
    assert all(asked[address] == (address, b"", 0) for address in set(asked) - read)


def test_an_adapter_without_empty_writes_says_so() -> None:
    """What was not answered is not taken for silence."""
    addresses = probe_addresses(Bus(0x50, fails=I2cError))
    assert addresses.answering == (0x50,)
    assert set(range(0x08, 0x78)) - {0x50} == set(addresses.unprobeable)


def test_a_held_line_ends_the_census() -> None:
    """It would cost a timeout for each address, and tell nothing."""
    bus = Bus(fails=I2cTimeoutError)
    with pytest.raises(I2cTimeoutError):
        probe_addresses(bus)
    assert len(bus.asked) == 1
