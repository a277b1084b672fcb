"""Section `can` of a configuration: the CAN interface."""

from typing import Annotated

from msgspec import Meta, Struct
from msgspec.structs import force_setattr

from footsense.wires.address import DEFAULT_CHANNELS, CanAddress, Interface


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

    @property
    def address(self) -> CanAddress:
        """What opens the interface."""
        return CanAddress(self.interface, self.channel, self.bitrate)
