"""What is connected to a bus is known for certain, or is written again."""

import pytest

from footsense.acquisition.leg_bus import LegBus
from footsense.errors import I2cError
from footsense.ports import Transaction


class FlakyBus:
    """A bus that takes every transaction, and fails to say so where it is told to."""

    def __init__(self) -> None:
        self.selected: list[int] = []
        self.fails = False

    def transfer(self, transaction: Transaction) -> bytes:
        self.selected.append(transaction.write[0])
        if self.fails:
            raise I2cError("not heard")
        return b""


def test_a_selection_that_may_have_been_taken_is_written_again() -> None:
    """After a failure neither the old legs nor the new ones count as connected."""
    bus = FlakyBus()
    upstream = LegBus(bus, 0x71)
    upstream.connect(0b11)
    upstream.connect(0b11)
    assert bus.selected == [0b11]
    bus.fails = True
    with pytest.raises(I2cError):
        upstream.connect(0b100)
    bus.fails = False
    upstream.connect(0b11)
    assert bus.selected == [0b11, 0b100, 0b11]
    upstream.forget_selection()
    upstream.connect(0b11)
    assert bus.selected == [0b11, 0b100, 0b11, 0b11]
