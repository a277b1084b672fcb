"""Schema of a test-stand file: reference force sensor under the foot, and its mounting."""

import struct
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from footsense import strict_yaml
from footsense.config.sections import Section
from footsense.reference.record_columns import NS_PER_TIME_COLUMN_UNIT, integer_widths_bits

Column = Literal["time_s", "time_ms", "time_us", "sequence", "fx", "fy", "fz", "saturated", "-"]
Columns = Annotated[tuple[Column, ...], Meta(min_length=3, max_length=40)]
Axis = Annotated[str, Meta(pattern=r"^[+-]?[xyz]$", description="an axis of the sensor, such as -z")]
SampleRateHz = Annotated[float, Meta(ge=10.0, le=10_000.0)]
RatedForce = Annotated[float, Meta(gt=0.0, le=1e9)]


class LineFraming(Section, frozen=True, kw_only=True, tag="lines", tag_field="kind"):
    """Framing of a sensor that sends records as lines of text.

    Attributes:
        columns: Meaning of each number of a line; "-" for an unused one.
        separator: Text between them; empty for white space.
    """

    columns: Columns
    separator: Annotated[str, Meta(max_length=3)] = ","


class BinaryFraming(Section, frozen=True, kw_only=True, tag="binary", tag_field="kind"):
    """Framing of a sensor that sends binary records of fixed length: sync bytes, values, checksum.

    Attributes:
        columns: Meaning of each value of a record; "-" for an unused one.
        layout: Format of the values as of Python's `struct`, such as "<Ihhh".
        sync: Bytes at the start of every record, in hexadecimal.
        checksum: Of the values: `sum8`, `xor8`, or `crc16` (CCITT-FALSE, little-endian).
    """

    columns: Columns
    layout: Annotated[str, Meta(min_length=1, max_length=60)]
    sync: Annotated[str, Meta(pattern=r"^([0-9A-Fa-f]{2}){1,8}$", description="such as AA55")]
    checksum: Literal["none", "sum8", "xor8", "crc16"] = "none"


class SerialSensor(Section, frozen=True, kw_only=True, tag="serial", tag_field="kind"):
    """Force sensor on a serial port.

    Attributes:
        device: The port; a name under /dev/serial/by-id survives unplugging.
        baud: Bits per second.
        framing: Format of its samples.
        rate_hz: Samples per second [Hz].
        start: Command that makes it stream; empty if it streams by itself.
        unit_per_count: Force of one count [`units`].
    """

    device: Annotated[
        str, Meta(pattern=r"^/dev/[^\s]+$", description="such as /dev/serial/by-id/usb-FTDI_...")
    ]
    framing: LineFraming | BinaryFraming
    rate_hz: SampleRateHz
    baud: Annotated[int, Meta(ge=1200, le=12_000_000)] = 115_200
    start: Annotated[str, Meta(max_length=60)] = ""
    unit_per_count: Annotated[float, Meta(gt=0.0)] = 1.0


class NetFt(Section, frozen=True, kw_only=True, tag="net_ft", tag_field="kind"):
    """Force sensor that streams over UDP as an ATI Net F/T does (RDT).

    Attributes:
        host: Its address.
        counts_per_force: Counts per unit of force, from its web page.
        rate_hz: Its RDT output rate [Hz].
        port: Its UDP port.
    """

    host: Annotated[str, Meta(min_length=1, max_length=255)]
    counts_per_force: Annotated[float, Meta(gt=0.0)]
    rate_hz: SampleRateHz
    port: Annotated[int, Meta(ge=1, le=65_535)] = 49_152


class FileSensor(Section, frozen=True, kw_only=True, tag="file", tag_field="kind"):
    """Recorded force sensor, replayed from the first scan on.

    Attributes:
        path: A .csv with columns `time_s` (or ms, us), `fx`, `fy`, `fz`; or a recording of a test stand, whose forces
            are in N and in the foot's axes.
    """

    path: Annotated[str, Meta(pattern=r"\.(csv|mcap)$", description="a .csv or .mcap file")]


class SimulatedForceSensor(Section, frozen=True, kw_only=True, tag="simulated", tag_field="kind"):
    """Simulated BL Autotech MINI 4/20 under the simulated foot [gf], its axes opposite to the foot's.

    Attributes:
        seed: Seed of the specimen.
        linearity_rel: Largest nonlinearity over the rated value [1].
    """

    seed: Annotated[int, Meta(ge=0)] = 1
    linearity_rel: Annotated[float, Meta(ge=0.0, le=0.1)] = 0.015


class Axes(Section, frozen=True, kw_only=True):
    """Signed sensor axis along each axis of the foot (x forward, y left, z up), for the force on the foot.

    A sensor under the foot reads the opposite force: all three have a minus.
    """

    x: Axis
    y: Axis
    z: Axis


class StandConfig(Section, frozen=True, kw_only=True):
    """Configuration of a test stand: reference force sensor and its mounting.

    Attributes:
        sensor: Its interface.
        axes: Its orientation in right angles.
        units: Unit of its forces.
        rated: Ends of the range of its own x, y and z, in that unit.
        mount_deg: Further rotation about the foot's x, then y, then z [deg].
        latency_ms: Smallest age of a sample on arrival, by filter and transmission [ms].
        description: One line for people.
    """

    sensor: SerialSensor | NetFt | FileSensor | SimulatedForceSensor
    axes: Axes
    units: Literal["N", "mN", "kgf", "gf", "lbf"]
    rated: tuple[RatedForce, RatedForce, RatedForce]
    mount_deg: tuple[
        Annotated[float, Meta(ge=-180.0, le=180.0)],
        Annotated[float, Meta(ge=-180.0, le=180.0)],
        Annotated[float, Meta(ge=-180.0, le=180.0)],
    ] = (0.0, 0.0, 0.0)
    latency_ms: Annotated[float, Meta(ge=0.0, le=1000.0)] = 0.0
    description: str = ""


def load_test_stand(path: Path) -> StandConfig:
    """Load a test stand from a YAML file; a recorded sensor's path is relative to the file's folder.

    Raises:
        ConfigError: The file is missing, is not such YAML, does not fit, or contradicts itself.
    """
    test_stand = strict_yaml.load(path, StandConfig, check=_contradiction)
    if not isinstance(test_stand.sensor, FileSensor):
        return test_stand
    sensor = msgspec.structs.replace(test_stand.sensor, path=str(path.parent / test_stand.sensor.path))
    return msgspec.structs.replace(test_stand, sensor=sensor)


def _contradiction(test_stand: StandConfig) -> strict_yaml.Problem | None:
    """Return the first contradiction between valid values; None if there is none."""
    axes = (test_stand.axes.x, test_stand.axes.y, test_stand.axes.z)
    if len({axis[-1] for axis in axes}) < len(axes):
        names = ", ".join(axes)
        return strict_yaml.Problem(
            "axes", f"{names} names an axis of the sensor twice; each belongs to one of x, y, z"
        )
    if isinstance(test_stand.sensor, SerialSensor):
        return _framing_contradiction(test_stand.sensor.framing)
    return None


def _framing_contradiction(framing: LineFraming | BinaryFraming) -> strict_yaml.Problem | None:
    """Return the first contradiction in a sensor's framing; None if there is none."""
    where = "sensor.framing"
    named = [column for column in framing.columns if column != "-"]
    for axis in ("fx", "fy", "fz"):
        if axis not in named:
            return strict_yaml.Problem(f"{where}.columns", f"no column is {axis}; a force has fx, fy and fz")
    if len(set(named)) < len(named) or len(set(named) & set(NS_PER_TIME_COLUMN_UNIT)) > 1:
        return strict_yaml.Problem(f"{where}.columns", "name one thing twice; call an unused column -")
    if isinstance(framing, LineFraming):
        return None
    try:
        n = len(integer_widths_bits(framing.layout))
    except struct.error as error:
        return strict_yaml.Problem(f"{where}.layout", f"{framing.layout!r} is no layout of numbers: {error}")
    if n != len(framing.columns):
        return strict_yaml.Problem(
            f"{where}.layout", f"has {n} values, but there are {len(framing.columns)} columns"
        )
    return None
