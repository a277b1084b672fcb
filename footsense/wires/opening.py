"""Open a CAN interface: a socket of Linux, or python-can's for those of a simulation."""

from collections.abc import Collection

from footsense.errors import CanError
from footsense.ports import CanWire
from footsense.wires.address import CanAddress, error_text
from footsense.wires.python_can import PythonCanWire
from footsense.wires.socket_wire import open_socket

#: Period of reading a channel [ns].
POLL_PERIOD_NS = 5_000_000


def open_wire(address: CanAddress, accept: Collection[int] = ()) -> CanWire:
    """Open and return a CAN interface.

    Args:
        address: The interface.
        accept: CAN ids that the kernel's filter accepts, on `socketcan`.

    Raises:
        CanError: There is no such interface.
    """
    if address.interface == "socketcan":
        return open_socket(address, accept)
    try:
        return PythonCanWire(address.interface, address.channel)
    except OSError as error:
        raise CanError(error_text(address, error)) from None
