"""Schemas of the sections of the configuration file, with the allowed range of each field."""

from typing import Annotated

from msgspec import Meta, Struct

from firmware_interface.chips import ad7147, tca9548a
from footsense.frames import ELEMENTS, Leg

#: PCA9685 servo boards answer to it beside their own address unless MODE1.ALLCALL is cleared.
PCA9685_ALLCALL_ADDRESS = 0x70

Channel = Annotated[int, Meta(ge=0, le=tca9548a.N_CHANNELS - 1, description="a channel of the TCA9548A")]
Address = Annotated[
    int,
    Meta(
        ge=ad7147.ADDRESSES[0],
        le=ad7147.ADDRESSES[-1],
        description=f"{ad7147.ADDRESSES[0]:#x} to {ad7147.ADDRESSES[-1]:#x}, by the straps ADD0 and ADD1 of an AD7147",
    ),
]
AdapterPath = Annotated[
    str, Meta(pattern=r"^(/dev/[^\s]+|sim[0-9]?)$", description="such as /dev/i2c-1, or sim")
]
_OfElements = Meta(
    min_length=ELEMENTS, max_length=ELEMENTS, description="a number for each of the nine elements"
)
StrayPf = Annotated[tuple[Annotated[float, Meta(ge=0.0, le=20.0)], ...], _OfElements]
UnloadedPf = Annotated[tuple[Annotated[float, Meta(ge=0.1, le=15.0)], ...], _OfElements]


class Section(Struct, frozen=True, forbid_unknown_fields=True):
    """Base class of the sections; an unknown key is an error."""


class ResetLine(Section, frozen=True, kw_only=True):
    """Section `reset`: GPIO line that drives the RESET pin of a mux.

    Attributes:
        device: GPIO chip: `/dev/gpiochipN`, or `sim` for a simulated one.
        line: Number of the line on that chip.
    """

    device: Annotated[
        str, Meta(pattern=r"^(/dev/gpiochip[0-9]+|sim)$", description="such as /dev/gpiochip0, or sim")
    ]
    line: Annotated[int, Meta(ge=0, le=1023)]


class Mux(Section, frozen=True, kw_only=True):
    """Section `mux`: TCA9548A multiplexer between an I2C bus and its legs.

    Attributes:
        address: 7-bit address on the upstream bus.
        reset: Line that drives its RESET pin; None if none does. Only RESET disconnects a leg that holds the bus low:
            without it, such a leg stops all legs of its bus.
    """

    address: Annotated[int, Meta(ge=0x70, le=0x77, description="0x70 to 0x77, set by its pins")] = (
        tca9548a.ADDRESS
    )
    reset: ResetLine | None = None


class Bus(Section, frozen=True, kw_only=True):
    """One I2C adapter with its legs: behind a multiplexer, with an address each, or one leg directly.

    Attributes:
        device: Adapter: `/dev/i2c-N`, or `sim`, `sim1`, ... for a simulated one.
        rate_hz: Clock of the bus [Hz], to compute how long a transaction takes; the kernel sets the clock.
        mux: Multiplexer, driven by footsense.
        legs: Channel of the multiplexer for each leg.
        leg: In place of `legs`, the one leg that is directly on the adapter; the channel of a multiplexer that the
            kernel drives (i2c-mux-pca954x) is such an adapter.
        addresses: In place of `legs`, with board `ad7147`: the address of each leg that is directly on the adapter, by
            the straps of its converter.
    """

    device: AdapterPath
    legs: dict[Leg, Channel] = {}
    leg: Leg | None = None
    addresses: dict[Leg, Address] = {}
    rate_hz: Annotated[
        int, Meta(ge=10_000, le=400_000, description="FDC1004 and TCA9548A are 400 kHz parts")
    ] = 400_000
    mux: Mux = Mux()

    @property
    def channels(self) -> dict[str, int]:
        """Channel of each leg; 0 of those that are directly on the adapter."""
        if self.leg is not None:
            return {self.leg: 0}
        if self.addresses:
            return dict.fromkeys(self.addresses, 0)
        return {leg: channel for leg, channel in self.legs.items()}  # noqa: C416 - of another type of key

    @property
    def converter_addresses(self) -> dict[str, int]:
        """Address of each leg's converter, of board `ad7147`."""
        return dict.fromkeys(self.channels, ad7147.ADDRESSES[0]) | dict(self.addresses.items())

    @property
    def mux_address(self) -> int | None:
        """Address of the multiplexer; None for legs directly on the adapter."""
        return self.mux.address if self.legs else None


class BaselineTracking(Section, frozen=True, kw_only=True):
    """Section `baseline`: drift tracking of the baseline between tares.

    Attributes:
        track: Whether the baseline follows drift in confirmed swing; on by default, because temperature moves it by
            about 1 mN/K, and the share of a load that it can absorb is bounded (docs/adr/0009).
    """

    track: bool = True


class Metrics(Section, frozen=True, kw_only=True):
    """Section `metrics`: address of `footsense exporter`.

    Attributes:
        address: Address that the exporter listens on; the loopback by default because the page has no password.
        port: TCP port of the exporter.
    """

    address: str = "127.0.0.1"
    port: Annotated[int, Meta(ge=1, le=65535)] = 9108


class PageServer(Section, frozen=True, kw_only=True):
    """Section `view`: address of the web page of `footsense view`.

    Attributes:
        address: Address that the page is served on; the loopback by default because the page has no password.
        port: TCP port of the page and of Foxglove's protocol; 8765 is the one that Foxglove tries first.
    """

    address: str = "127.0.0.1"
    port: Annotated[int, Meta(ge=1, le=65535)] = 8765


class Realtime(Section, frozen=True, kw_only=True):
    """Section `realtime` of a configuration: scheduling that the main loop requests from the kernel.

    Attributes:
        priority: SCHED_FIFO priority; below 50, that of the kernel's interrupt threads, for which the loop waits.
        required: Whether the service refuses to start if a request is denied; else its frames say degraded_timing.
    """

    priority: Annotated[int, Meta(ge=1, le=99)] = 40
    required: bool = False
