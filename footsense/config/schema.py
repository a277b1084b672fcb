"""The shape of a configuration file: one field, one reason, one range.

Paths and remedies of what contradicts itself are in `footsense.config.contradictions`.
"""

from collections.abc import Mapping
from ipaddress import ip_address
from typing import Annotated, Literal

from msgspec import Meta, Struct

from firmware_interface import ad7746, fdc1004, tca9548a
from footsense.config.boards import BOARDS
from footsense.frames import ELEMENTS, LEGS

__all__ = [
    "PCA9685_ALLCALL",
    "Bus",
    "Can",
    "Config",
    "Contact",
    "Metrics",
    "Mux",
    "OtherDevice",
    "Realtime",
    "ResetLine",
    "Scan",
    "Serial",
    "Tare",
    "Zero",
]

Leg = Literal["lf", "lm", "lr", "rf", "rm", "rr"]

#: PCA9685 servo boards answer to it beside their own address unless MODE1.ALLCALL is cleared.
PCA9685_ALLCALL = 0x70

Channel = Annotated[int, Meta(ge=0, le=tca9548a.CHANNELS - 1, description="a channel of the TCA9548A")]
Device = Annotated[str, Meta(pattern=r"^(/dev/[^\s]+|sim[0-9]?)$", description="such as /dev/i2c-1, or sim")]
StrayPf = Annotated[
    tuple[Annotated[float, Meta(ge=0.0, le=20.0)], ...], Meta(min_length=ELEMENTS, max_length=ELEMENTS)
]
UnloadedPf = Annotated[
    tuple[Annotated[float, Meta(ge=0.1, le=15.0)], ...], Meta(min_length=ELEMENTS, max_length=ELEMENTS)
]
FootId = Annotated[str, Meta(pattern=r"^foot-[0-9]{4}$", description="such as foot-0007")]


class ResetLine(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The GPIO line that drives the RESET pin of a multiplexer.

    Attributes:
        device: The GPIO chip: `/dev/gpiochipN`, or `sim` for a simulated one.
        line: Its number on that chip.
    """

    device: Annotated[
        str, Meta(pattern=r"^(/dev/gpiochip[0-9]+|sim)$", description="such as /dev/gpiochip0, or sim")
    ]
    line: Annotated[int, Meta(ge=0, le=1023)]


class Mux(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The TCA9548A that stands between a bus and its legs.

    Attributes:
        address: 7-bit address on the trunk.
        reset: What drives its RESET pin; None for nothing. Only that disconnects a leg that holds the bus low: without
            it, such a leg stops all legs of its bus.
    """

    address: Annotated[int, Meta(ge=0x70, le=0x77, description="0x70 to 0x77, set by its pins")] = (
        tca9548a.ADDRESS
    )
    reset: ResetLine | None = None


class OtherDevice(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Something else that answers on the trunk of a bus, named so that a clash is found in time.

    Attributes:
        name: What it is.
        address: Its 7-bit address.
    """

    name: Annotated[str, Meta(min_length=1, max_length=40)]
    address: Annotated[int, Meta(ge=0x03, le=0x77, description="a 7-bit address, 0x03 to 0x77")]


class Bus(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One I2C adapter, its multiplexer, and the legs behind it.

    Attributes:
        device: The adapter: `/dev/i2c-N`, or `sim`, `sim1`, ... for a simulated one.
        rate_hz: Clock of the bus [Hz]; tells how long a transaction takes, does not set it.
        mux: The multiplexer.
        legs: Channel of the multiplexer for each leg; or, where the kernel drives it (i2c-mux-pca954x), the adapter
            that it made of the leg's channel.
        other_devices: What else answers on the trunk.
    """

    device: Device
    legs: Annotated[dict[Leg, Channel | Device], Meta(min_length=1)]
    rate_hz: Annotated[
        int, Meta(ge=10_000, le=400_000, description="FDC1004 and TCA9548A are 400 kHz parts")
    ] = 400_000
    mux: Mux = Mux()
    other_devices: tuple[OtherDevice, ...] = ()

    @property
    def channels(self) -> dict[str, int]:
        """Return each leg's channel; none where the kernel drives the multiplexer."""
        return {leg: channel for leg, channel in self.legs.items() if isinstance(channel, int)}

    @property
    def adapters(self) -> dict[str, str]:
        """Return each leg's adapter where the kernel drives the multiplexer; none where it does not."""
        return {leg: device for leg, device in self.legs.items() if isinstance(device, str)}


class Serial(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The line to the microcontroller of board `mcu`, which scans the feet by itself.

    Attributes:
        device: Its name under /dev/serial/by-id, which stays when it is unplugged; or `sim`.
        baud: Bits per second of a UART or adapter; a microcontroller that is a USB device itself minds none.
        rate_hz: Scans per second that it makes; tells when one is missing, does not set it.
        legs: Whose feet it scans.
    """

    device: Annotated[
        str,
        Meta(pattern=r"^(/dev/[^\s]+|sim)$", description="such as /dev/serial/by-id/usb-..., or sim"),
    ]
    baud: Annotated[int, Meta(ge=9600, le=12_000_000)] = 921_600
    rate_hz: Annotated[float, Meta(ge=1.0, le=1000.0)] = 200.0
    legs: Annotated[tuple[Leg, ...], Meta(min_length=1, max_length=len(LEGS))] = LEGS  # type: ignore[assignment]


class Scan(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the elements are read.

    Attributes:
        rate_sps: Conversions per second of one converter, slower is quieter: 100, 200 or 400 with board `fdc1004`; 9,
            11, 13, 16, 26, 50, 84 or 91 with board `ad7746`. None: the board's fastest.
        order: Order of the elements: `lo_shu` keeps opposite ones at the same mean time, `raster` switches half as many
            rows; brought to one time, they err alike. None: lo_shu, or raster where the kernel drives the multiplexer.
    """

    rate_sps: Literal[9, 11, 13, 16, 26, 50, 84, 91, 100, 200, 400] | None = None
    order: Literal["lo_shu", "raster"] | None = None


class Tare(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When the present capacitances may become those of the unloaded foot.

    Attributes:
        window_frames: Scans that are averaged.
        noise_limit_ff: Largest standard deviation of an element over the window [fF].
        unloaded_limit_rel: Largest deviation of an element's capacitance from `unloaded_pf` that counts as unloaded;
            3 % of the capacitance are 4 % of the gap.
    """

    window_frames: Annotated[int, Meta(ge=2, le=1000)] = 8
    noise_limit_ff: Annotated[float, Meta(gt=0.0, le=1000.0)] = 5.0
    unloaded_limit_rel: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.03


class Zero(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What happens to the zero of a foot between tares.

    Attributes:
        track: Whether it follows a foot that is surely in the air; by default, because temperature moves a zero by
            about 1 mN/K, and what it can take of a load is bounded (docs/adr/0009).
    """

    track: bool = True


class Contact(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When a foot is on the ground.

    Attributes:
        touch_n: Load along the leg from which it is, above what it reads in the air [N]; it leaves at half of that.
            Well above what the swing itself makes of the foot's own mass, well below what a stance carries.
    """

    touch_n: Annotated[float, Meta(ge=0.002, le=10.0)] = 0.03


class Can(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the forces go.

    Attributes:
        interface: `socketcan` on the robot; `virtual` stays within the process, `udp_multicast` on this computer.
        channel: Name of the network interface; with `udp_multicast` an address such as 239.74.163.2.
        bitrate: For information [bit/s]: the kernel sets it (deploy/README.md).
    """

    interface: Literal["virtual", "socketcan", "udp_multicast"]
    channel: Annotated[
        str, Meta(pattern=r"^[^\s/]{1,15}$", description="a network interface such as can0")
    ] = "can0"
    bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000, description="classic CAN ends at 1 Mbit/s")] = (
        500_000
    )


class Metrics(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where Prometheus finds the counters.

    Attributes:
        address: Address to listen on; the loopback by default because the page has no password.
        port: TCP port.
    """

    address: str = "127.0.0.1"
    port: Annotated[int, Meta(ge=1, le=65535)] = 9108


class Realtime(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the loop asks of the scheduler.

    Attributes:
        priority: SCHED_FIFO priority; below 50, where the kernel's interrupt threads run: the loop waits for them.
        cpu: Processor to stay on; None leaves it to the kernel.
        required: Whether the service refuses to start without what it asks for; else its frames say degraded_timing.
    """

    priority: Annotated[int, Meta(ge=1, le=99)] = 40
    cpu: Annotated[int, Meta(ge=0, le=1023)] | None = None
    required: bool = False


class Config(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that the daemon is told.

    Attributes:
        board: Electronics of a foot.
        buses: I2C adapters; none with board `mcu`.
        serial: The line to the microcontroller; with board `mcu` only.
        can: Where the forces go. No default: a robot whose forces stay in the process would look healthy.
        scan: How the elements are read.
        publish: When a force goes out: `frame`, with every scan, as of its middle; `element`, with every conversion,
            predicted to the time of sending.
        average_scans: Scans that are averaged before a force is made of them; with `publish: frame` only.
        tare: When a foot counts as quiet and unloaded.
        zero: What happens to it between tares.
        contact: When a foot is on the ground.
        max_age_ms: Age of its oldest element at which a measurement becomes `stale` [ms]; None for four scans,
            more by those that are averaged.
        stray_pf: Capacitance beside each element that is not the foot's [pF], nine per leg; 0 where absent.
        unloaded_pf: What each element of a mounted foot reads while nothing presses it, stray included [pF], nine per
            leg; none given means the design's. A tare must come near it.
        foot_type: Which type of foot is mounted: the name of a released one, or, with a slash, the folder that
            `footsense lab build` made of another, relative to the file. The folder has the name of the type.
        model: Network to use, relative to the file; None for that of the foot type.
        feet: Which foot is mounted on which leg.
        body_weight_n: What all legs carry together while the robot walks [N], to tell feet whose calibration no longer
            holds; None compares their sum with what it was at first.
        calibrations: Folder of the feet's calibrations, relative to the file; every foot in `feet` needs one there, which
            brings its stray_pf, unloaded_pf and network. None reads every foot as designed.
        metrics: Where the counters are shown; None for nowhere.
        realtime: What the loop asks of the scheduler; None for nothing.
    """

    board: Literal["fdc1004", "ad7746", "mcu"] = "fdc1004"
    buses: Annotated[tuple[Bus, ...], Meta(max_length=6)] = ()
    serial: Serial | None = None
    can: Annotated[Can, Meta(description="interface: socketcan, channel: can0 on a robot")]
    scan: Scan = Scan()
    publish: Literal["frame", "element"] = "frame"
    average_scans: Annotated[int, Meta(ge=1, le=16)] = 1
    tare: Tare = Tare()
    zero: Zero = Zero()
    contact: Contact = Contact()
    max_age_ms: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    stray_pf: dict[Leg, StrayPf] = {}
    unloaded_pf: dict[Leg, UnloadedPf] = {}
    foot_type: Annotated[
        str,
        Meta(
            pattern=r"^(.*/)?[a-z0-9][a-z0-9-]{0,39}$",
            description="such as aoyagi-3x3, or ./models/my-foot for a folder",
        ),
    ] = "aoyagi-3x3"
    model: Annotated[str, Meta(min_length=1)] | None = None
    feet: dict[Leg, FootId] = {}
    body_weight_n: Annotated[float, Meta(gt=0.0, le=1000.0)] | None = None
    calibrations: Annotated[str, Meta(min_length=1)] | None = None
    metrics: Metrics | None = None
    realtime: Realtime | None = None

    @property
    def legs(self) -> tuple[str, ...]:
        """Return the configured legs bus by bus: the rows of every frame."""
        if self.serial is not None:
            return self.serial.legs
        return tuple(leg for bus in self.buses for leg in bus.legs)

    @property
    def shortest_scan_ms(self) -> float:
        """Return the time that a scan takes at least [ms]: its conversions, or the microcontroller's pace."""
        if self.serial is not None:
            return 1e3 / self.serial.rate_hz
        return ELEMENTS * self.rate.conversion_ns * 1e-6

    @property
    def rate_sps(self) -> int:
        """Return the conversions per second of one converter."""
        return self.scan.rate_sps or max(self._rates)

    @property
    def rate(self) -> fdc1004.Rate | ad7746.Rate:
        """Return time and noise of a conversion."""
        return self._rates[self.rate_sps]

    @property
    def _rates(self) -> Mapping[int, fdc1004.Rate | ad7746.Rate]:
        # What converters a microcontroller has is not known here; those of the default board are taken.
        return BOARDS.get(self.board, BOARDS["fdc1004"]).rates

    @property
    def order(self) -> Literal["lo_shu", "raster"]:
        """Return the order of the elements: as given, or the one that suits the multiplexer."""
        return self.scan.order or ("raster" if any(bus.adapters for bus in self.buses) else "lo_shu")

    @property
    def stale_after_ms(self) -> float:
        """Return the age limit of a measurement [ms]: as given, or three scans more than are averaged."""
        if self.max_age_ms is not None:
            return self.max_age_ms
        return (3 + self.average_scans) * self.shortest_scan_ms

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return what is allowed but has surprised others, each as one line with its path."""
        found = [
            f"buses[{i}].mux.address: 0x70 is also the ALLCALL address of PCA9685 servo boards; prefer 0x71"
            for i, bus in enumerate(self.buses)
            if bus.mux.address == PCA9685_ALLCALL
        ]
        if self.metrics is not None and not ip_address(self.metrics.address).is_loopback:
            found.append(f"metrics.address: the network reads {self.metrics.address} without a password")
        devices = [bus.device for bus in self.buses]
        if self.serial is not None:
            devices = [self.serial.device]
            if self.serial.device.startswith("/dev/tty"):
                found.append(
                    f"serial.device: {self.serial.device} may be another device when it is plugged in again; "
                    "prefer its name under /dev/serial/by-id"
                )
        if self.can.interface != "socketcan" and any(device.startswith("/dev/") for device in devices):
            where = "process" if self.can.interface == "virtual" else "computer"
            found.append(
                f"can.interface: {self.can.interface} never leaves the {where}; "
                "the robot's controller needs socketcan"
            )
        return tuple(found)
