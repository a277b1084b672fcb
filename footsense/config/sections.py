"""Schemas of the sections of the configuration file, with the allowed range of each field."""

from typing import Annotated, Literal

from msgspec import Meta, Struct

from firmware_interface.chips import tca9548a
from footsense.frames import ALL_LEGS, ELEMENTS, LEGS

Leg = Literal["lf", "lm", "lr", "rf", "rm", "rr", "l4", "r4"]

#: PCA9685 servo boards answer to it beside their own address unless MODE1.ALLCALL is cleared.
PCA9685_ALLCALL_ADDRESS = 0x70

Channel = Annotated[int, Meta(ge=0, le=tca9548a.N_CHANNELS - 1, description="a channel of the TCA9548A")]
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
        read_back: Whether it is read back after every leg: another program that switches it, such as i2cset, would make
            one leg's reading another's. None: where that takes no time from the scan.
    """

    address: Annotated[int, Meta(ge=0x70, le=0x77, description="0x70 to 0x77, set by its pins")] = (
        tca9548a.ADDRESS
    )
    reset: ResetLine | None = None
    read_back: bool | None = None


class Bus(Section, frozen=True, kw_only=True):
    """One I2C adapter with its legs: behind a multiplexer, or one leg directly.

    Attributes:
        device: Adapter: `/dev/i2c-N`, or `sim`, `sim1`, ... for a simulated one.
        rate_hz: Clock of the bus [Hz], to compute how long a transaction takes; the kernel sets the clock.
        mux: Multiplexer, driven by footsense.
        legs: Channel of the multiplexer for each leg.
        leg: In place of `legs`, the one leg that is directly on the adapter; the channel of a multiplexer that the
            kernel drives (i2c-mux-pca954x) is such an adapter.
    """

    device: AdapterPath
    legs: dict[Leg, Channel] = {}
    leg: Leg | None = None
    rate_hz: Annotated[
        int, Meta(ge=10_000, le=400_000, description="FDC1004 and TCA9548A are 400 kHz parts")
    ] = 400_000
    mux: Mux = Mux()

    @property
    def channels(self) -> dict[str, int]:
        """Channel of each leg; 0 of one that is directly on the adapter."""
        if self.leg is not None:
            return {self.leg: 0}
        return {leg: channel for leg, channel in self.legs.items()}  # noqa: C416 - of another type of key

    @property
    def mux_address(self) -> int | None:
        """Address of the multiplexer; None for a leg directly on the adapter."""
        return self.mux.address if self.leg is None else None


class Serial(Section, frozen=True, kw_only=True):
    """Section `serial`: serial port of the microcontroller of board `mcu`, which scans the feet.

    Attributes:
        device: Port under /dev/serial/by-id, a name that survives unplugging; or `sim`.
        baud: Bits per second of a UART or adapter; without effect if the microcontroller is a USB device itself.
        rate_hz: Scans per second of the microcontroller, to detect missing ones; does not set its rate.
        legs: Legs that it scans.
    """

    device: Annotated[
        str,
        Meta(pattern=r"^(/dev/[^\s]+|sim)$", description="such as /dev/serial/by-id/usb-..., or sim"),
    ]
    baud: Annotated[int, Meta(ge=9600, le=12_000_000)] = 921_600
    rate_hz: Annotated[float, Meta(ge=1.0, le=1000.0)] = 200.0
    legs: Annotated[tuple[Leg, ...], Meta(min_length=1, max_length=len(ALL_LEGS))] = LEGS  # type: ignore[assignment]


class Scan(Section, frozen=True, kw_only=True):
    """Section `scan`: conversion rate and order of the elements.

    Attributes:
        rate_sps: Conversions per second of one converter; a lower rate has less noise: 100, 200 or 400 with board
            `fdc1004`; 9, 11, 13, 16, 26, 50, 84 or 91 with board `ad7746`. None: the board's fastest.
        order: Order of the elements: `lo_shu` (the magic square) keeps opposite ones at the same mean time, `raster`
            switches half as many rows; the network is trained for both. None: lo_shu.
    """

    rate_sps: Literal[9, 11, 13, 16, 26, 50, 84, 91, 100, 200, 400] | None = None
    order: Literal["lo_shu", "raster"] | None = None


class Tare(Section, frozen=True, kw_only=True):
    """Section `tare`: conditions under which the present readings become the baseline of a foot.

    Attributes:
        window_scans: Scans averaged.
        noise_limit_ff: Largest standard deviation of an element over the window [fF].
        unloaded_limit_rel: Largest deviation of an element from `unloaded_pf` that counts as unloaded [1]; 3 % of the
            capacitance are 4 % of the gap.
    """

    window_scans: Annotated[int, Meta(ge=2, le=1000)] = 8
    noise_limit_ff: Annotated[float, Meta(gt=0.0, le=1000.0)] = 5.0
    unloaded_limit_rel: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.03


class BaselineTracking(Section, frozen=True, kw_only=True):
    """Section `baseline`: drift tracking of the baseline between tares.

    Attributes:
        track: Whether the baseline follows drift in confirmed swing; on by default, because temperature moves it by
            about 1 mN/K, and the share of a load that it can absorb is bounded (docs/adr/0009).
    """

    track: bool = True


class Contact(Section, frozen=True, kw_only=True):
    """Section `contact`: threshold of contact detection.

    Attributes:
        threshold_n: Load along the leg, above the reading in swing, from which a foot is in contact [N]; contact ends
            at half of it. Well above the inertial force of the foot's own mass in swing, well below a stance's load.
            None: 1.5 % of the feet's largest force, 0.03 N for the paper's.
    """

    threshold_n: Annotated[float, Meta(ge=0.002, le=10.0)] | None = None


class Can(Section, frozen=True, kw_only=True):
    """Section `can`: CAN interface on which forces are published.

    Attributes:
        interface: `socketcan` on the robot; `virtual` stays within the process, `udp_multicast` on this computer.
        channel: Name of the network interface; with `udp_multicast` an address such as 239.74.163.2.
        bitrate: Bit rate [bit/s], to compute the bus load; the kernel sets it (deploy/README.md).
        commands: Whether commands are executed. None: those of a CAN bus, but not those of `udp_multicast`, which every
            program on this computer can send.
        fd: Whether the forces of all legs go out in one CAN FD frame; the interface has to be one of CAN FD.
    """

    interface: Annotated[
        Literal["virtual", "socketcan", "udp_multicast"],
        Meta(description="a CAN device of Linux: interface: socketcan, channel: can0, or vcan0"),
    ]
    channel: Annotated[
        str, Meta(pattern=r"^[^\s/]{1,15}$", description="a network interface such as can0")
    ] = "can0"
    bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000, description="classic CAN ends at 1 Mbit/s")] = (
        500_000
    )
    commands: bool | None = None
    fd: bool = False

    @property
    def executes_commands(self) -> bool:
        """Whether commands received on CAN are executed."""
        return self.interface != "udp_multicast" if self.commands is None else self.commands


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
    """Section `realtime`: scheduling that the main loop requests from the kernel.

    Attributes:
        priority: SCHED_FIFO priority; below 50, that of the kernel's interrupt threads, for which the loop waits.
        cpu: Processor to stay on; None lets the kernel choose.
        required: Whether the service refuses to start if a request is denied; else its frames say degraded_timing.
    """

    priority: Annotated[int, Meta(ge=1, le=99)] = 40
    cpu: Annotated[int, Meta(ge=0, le=1023)] | None = None
    required: bool = False
