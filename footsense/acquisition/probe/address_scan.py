"""Address scan of an I2C bus, with transactions that are harmless to the chips.

An empty write is the gentlest: START, address, acknowledge, STOP. But to the EEPROM AT24RF08 (0x54 to 0x57) it is the
beginning of a write, and memory modules have write-protect registers at 0x30 to 0x37: there one byte is read instead,
which in turn locks up write-only clock chips such as those at 0x69. `i2cdetect` does the same by default. Addresses
below 0x08 and above 0x77 are reserved (UM10204, table 4); they and chips held by a driver of the kernel are left alone.
"""

from collections.abc import Collection
from typing import NamedTuple

from footsense.errors import I2cError, I2cTimeoutError, NackError
from footsense.ports import I2cBus, Transaction

#: Addresses that a chip may have.
ADDRESSES = range(0x08, 0x78)

_ADDRESSES_PROBED_BY_READ = {*range(0x30, 0x38), *range(0x50, 0x60)}


class AddressProbe(NamedTuple):
    """Result of an address scan: I2C addresses that answered, and those that were not probed.

    Attributes:
        answering: Addresses that acknowledged.
        unprobeable: Addresses that this adapter cannot probe, most often because it does not support empty writes.
    """

    answering: tuple[int, ...]
    unprobeable: tuple[int, ...] = ()


def probe_addresses(bus: I2cBus, skipped: Collection[int] = ()) -> AddressProbe:
    """Probe every I2C address once; return which acknowledged.

    Args:
        bus: The bus, with the channels that are connected.
        skipped: Addresses not to probe.

    Raises:
        I2cTimeoutError: A line is stuck: no chip can answer.
    """
    answering, not_probed = [], []
    for address in ADDRESSES:
        if address in skipped:
            continue
        try:
            bus.transfer(Transaction(address, b"", int(address in _ADDRESSES_PROBED_BY_READ)))
        except NackError:
            continue
        except I2cTimeoutError:
            raise
        except I2cError:
            not_probed.append(address)
        else:
            answering.append(address)
    return AddressProbe(tuple(answering), tuple(not_probed))
