"""The shape of a bench's file: which force sensor stands under the foot, and how it sits."""

import struct
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from footsense import strict_yaml
from footsense.reference.record_decoder import TIMES, integer_bits

__all__ = ["Axes", "Bench", "Binary", "FileSensor", "Lines", "NetFt", "Serial", "Simulated", "load_bench"]

Column = Literal["time_s", "time_ms", "time_us", "sequence", "fx", "fy", "fz", "saturated", "-"]
Columns = Annotated[tuple[Column, ...], Meta(min_length=3, max_length=40)]
Axis = Annotated[str, Meta(pattern=r"^[+-]?[xyz]$", description="an axis of the sensor, such as -z")]
Rate = Annotated[float, Meta(ge=10.0, le=10_000.0)]
Range = Annotated[float, Meta(gt=0.0, le=1e9)]


class _Part(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A strict part of a bench."""


class Lines(_Part, frozen=True, tag="lines", tag_field="kind"):
    """Lines of text.

    Attributes:
        columns: What each number of a line is; "-" for what is of no use.
        separator: What stands between them; empty for white space.
    """

    columns: Columns
    separator: Annotated[str, Meta(max_length=3)] = ","


class Binary(_Part, frozen=True, tag="binary", tag_field="kind"):
    """Binary records of one length: sync bytes, values, checksum.

    Attributes:
        columns: What each value of a record is; "-" for what is of no use.
        layout: The values in the letters of Python's `struct`, such as "<Ihhh".
        sync: The bytes that every record begins with, in hexadecimal.
        checksum: Over the values: `sum8`, `xor8`, or `crc16` (CCITT-FALSE, little-endian).
    """

    columns: Columns
    layout: Annotated[str, Meta(min_length=1, max_length=60)]
    sync: Annotated[str, Meta(pattern=r"^([0-9A-Fa-f]{2}){1,8}$", description="such as AA55")]
    checksum: Literal["none", "sum8", "xor8", "crc16"] = "none"


class Serial(_Part, frozen=True, tag="serial", tag_field="kind"):
    """A sensor on a serial port.

    Attributes:
        device: The port; a name under /dev/serial/by-id finds it again when it was unplugged.
        baud: Bits per second.
        framing: How its samples come.
        rate_hz: Samples per second.
        start: What it has to be sent before it streams.
        unit_per_count: What one count of its forces is.
    """

    device: Annotated[
        str, Meta(pattern=r"^/dev/[^\s]+$", description="such as /dev/serial/by-id/usb-FTDI_...")
    ]
    framing: Lines | Binary
    rate_hz: Rate
    baud: Annotated[int, Meta(ge=1200, le=12_000_000)] = 115_200
    start: Annotated[str, Meta(max_length=60)] = ""
    unit_per_count: Annotated[float, Meta(gt=0.0)] = 1.0


class NetFt(_Part, frozen=True, tag="net_ft", tag_field="kind"):
    """A sensor that streams over UDP as an ATI Net F/T does (RDT).

    Attributes:
        host: Its address.
        counts_per_force: Counts of a unit of force, as its web page says.
        rate_hz: Its RDT output rate.
        port: Its UDP port.
    """

    host: Annotated[str, Meta(min_length=1, max_length=255)]
    counts_per_force: Annotated[float, Meta(gt=0.0)]
    rate_hz: Rate
    port: Annotated[int, Meta(ge=1, le=65_535)] = 49_152


class FileSensor(_Part, frozen=True, tag="file", tag_field="kind"):
    """A recorded sensor, played from the first scan on.

    Attributes:
        path: A .csv with columns `time_s` (or ms, us), `fx`, `fy`, `fz`; or a recording of a bench, which is in N and
            in the foot's axes already.
    """

    path: Annotated[str, Meta(pattern=r"\.(csv|mcap)$", description="a .csv or .mcap file")]


class Simulated(_Part, frozen=True, tag="simulated", tag_field="kind"):
    """A simulated MINI 4/20 under the simulated foot; it speaks in gf, and its axes are all against the foot's.

    Attributes:
        seed: Of the specimen.
        linearity_rel: How far its readings are bent at most, of the rated value [1].
    """

    seed: Annotated[int, Meta(ge=0)] = 1
    linearity_rel: Annotated[float, Meta(ge=0.0, le=0.1)] = 0.015


class Axes(_Part, frozen=True):
    """Axis of the sensor that is each of the foot's (x forward, y left, z up), for the force of the ground on the foot.

    A sensor that the foot pushes on from above reads the opposite force: all three have a minus then.
    """

    x: Axis
    y: Axis
    z: Axis


class Bench(_Part, frozen=True):
    """What stands under the foot.

    Attributes:
        sensor: The force sensor and how it speaks.
        axes: How it is turned, by right angles.
        units: What its forces are in.
        rated: Ends of the range of its own x, y and z, in these units.
        mount_deg: What it is turned besides, about the foot's x, then y, then z [deg].
        latency_ms: How old a sample is when it arrives at the soonest: filter and transmission [ms].
        description: One line for the reader.
    """

    sensor: Serial | NetFt | FileSensor | Simulated
    axes: Axes
    units: Literal["N", "mN", "kgf", "gf", "lbf"]
    rated: tuple[Range, Range, Range]
    mount_deg: tuple[
        Annotated[float, Meta(ge=-180.0, le=180.0)],
        Annotated[float, Meta(ge=-180.0, le=180.0)],
        Annotated[float, Meta(ge=-180.0, le=180.0)],
    ] = (0.0, 0.0, 0.0)
    latency_ms: Annotated[float, Meta(ge=0.0, le=1000.0)] = 0.0
    description: str = ""


def load_bench(path: Path) -> Bench:
    """Return the bench in a YAML file, the path of a recorded sensor resolved against the file's directory.

    Raises:
        ConfigError: The file is missing, is not such YAML, does not fit, or contradicts itself.
    """
    bench = strict_yaml.load(path, Bench, check=_contradiction)
    if not isinstance(bench.sensor, FileSensor):
        return bench
    sensor = msgspec.structs.replace(bench.sensor, path=str(path.parent / bench.sensor.path))
    return msgspec.structs.replace(bench, sensor=sensor)


def _contradiction(bench: Bench) -> strict_yaml.Problem | None:
    """Return what is right by itself and cannot be meant."""
    axes = (bench.axes.x, bench.axes.y, bench.axes.z)
    if len({axis[-1] for axis in axes}) < len(axes):
        said = ", ".join(axes)
        return strict_yaml.Problem(
            "axes", f"{said} names an axis of the sensor twice; each belongs to one of x, y, z"
        )
    if isinstance(bench.sensor, Serial):
        return _framing(bench.sensor.framing)
    return None


def _framing(framing: Lines | Binary) -> strict_yaml.Problem | None:
    where = "sensor.framing"
    named = [column for column in framing.columns if column != "-"]
    for axis in ("fx", "fy", "fz"):
        if axis not in named:
            return strict_yaml.Problem(f"{where}.columns", f"no column is {axis}; a force has fx, fy and fz")
    if len(set(named)) < len(named) or len(set(named) & set(TIMES)) > 1:
        return strict_yaml.Problem(f"{where}.columns", "name one thing twice; call what is of no use -")
    if isinstance(framing, Lines):
        return None
    try:
        n = len(integer_bits(framing.layout))
    except struct.error as error:
        return strict_yaml.Problem(f"{where}.layout", f"{framing.layout!r} is no layout of numbers: {error}")
    if n != len(framing.columns):
        return strict_yaml.Problem(
            f"{where}.layout", f"has {n} values, but there are {len(framing.columns)} columns"
        )
    return None
