"""Open a CAN interface: a socket of Linux, or python-can's for those of a simulation."""

from collections.abc import Collection

from footsense.errors import CanError
from footsense.ports import CanWire
from footsense.wires.address import DEFAULT_CHANNELS, CanAddress, error_text
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
    from footsense.wires.python_can import PythonCanWire  # a robot does not load python-can

    try:
        return PythonCanWire(address.interface, address.channel)
    except OSError as error:
        raise CanError(error_text(address, error)) from None


def open_client_wire(address: CanAddress, accept: Collection[int]) -> CanWire:
    """Open a CAN interface beside a service; arguments as of `open_wire`.

    Raises:
        CanError: There is no such interface; of one that is CAN, the message has the address of a simulation.
    """
    try:
        return open_wire(address, accept)
    except CanError as error:
        if address.interface != "socketcan":
            raise
        raise CanError(f"{error}; of a simulation: {DEFAULT_CHANNELS['udp_multicast']}") from None
