"""Section `can` of a configuration: the CAN interface, and its errors in words with a remedy."""

import errno
from typing import Annotated, Literal

from msgspec import Meta, Struct
from msgspec.structs import force_setattr

Interface = Literal["virtual", "socketcan", "udp_multicast"]

#: Default channel of each interface that other programs hear; the address of a group is that of python-can.
DEFAULT_CHANNELS = {"socketcan": "can0", "udp_multicast": "239.74.163.2"}


class Can(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Section `can` of a configuration: CAN interface on which forces are published.

    Attributes:
        interface: `socketcan` on the robot; `virtual` stays within the process, `udp_multicast` on this computer.
        channel: Name of the network interface, by default can0; with `udp_multicast` an address, by default
            239.74.163.2.
        bitrate: Bit rate [bit/s], to compute the bus load; the kernel sets it (deploy/README.md).
        commands: Whether commands are executed, and motions of the legs taken. None: those of a CAN bus, but not those
            of `udp_multicast`, which every program on this computer can send.
    """

    interface: Annotated[
        Interface,
        Meta(description="a CAN device of Linux: interface: socketcan, channel: can0, or vcan0"),
    ]
    channel: Annotated[
        str, Meta(pattern=r"^[^\s/]{1,15}$", description="a network interface such as can0")
    ] = ""
    bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000, description="classic CAN ends at 1 Mbit/s")] = (
        500_000
    )
    commands: bool | None = None

    def __post_init__(self) -> None:
        """Set the channel that belongs to the interface where none is named."""
        if not self.channel:
            force_setattr(
                self, "channel", DEFAULT_CHANNELS.get(self.interface, DEFAULT_CHANNELS["socketcan"])
            )

    @property
    def bit_ns(self) -> float:
        """Duration of a bit on the bus [ns]."""
        return 1e9 / self.bitrate

    @property
    def executes_commands(self) -> bool:
        """Whether commands received on CAN are executed, and motions taken."""
        return self.interface != "udp_multicast" if self.commands is None else self.commands


def error_text(can: Can, error: OSError) -> str:
    """Return an error of a CAN interface and its remedy as one line of text."""
    channel = can.channel
    name = f"CAN channel {channel} ({can.interface})"
    match error.errno:
        case errno.ENETDOWN:
            kind = "" if channel.startswith("vcan") else f" type can bitrate {can.bitrate}"
            return f"{name} is down; try: ip link set {channel} up{kind}"
        case errno.ENODEV | errno.ENXIO:
            return f"{name} does not exist; those that do: ip -details link show type can"
        case errno.EAFNOSUPPORT:
            return f"{name} needs a kernel with CAN; try: modprobe can_raw"
        case _:
            return f"{name} cannot be opened: {error.strerror or error}"
