"""Schema of a test-stand file: reference force sensor under the foot, and its mounting."""

from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from footsense import strict_yaml
from footsense.config.sections import Section
from footsense.reference.serial_sensor import NS_PER_TIME_COLUMN_UNIT

Column = Literal["time_s", "time_ms", "time_us", "sequence", "fx", "fy", "fz", "saturated", "-"]
Columns = Annotated[tuple[Column, ...], Meta(min_length=3, max_length=40)]
Axis = Annotated[str, Meta(pattern=r"^[+-]?[xyz]$", description="an axis of the sensor, such as -z")]
SampleRateHz = Annotated[float, Meta(ge=10.0, le=10_000.0)]
RatedForce = Annotated[float, Meta(gt=0.0, le=1e9)]


class SerialSensor(Section, frozen=True, kw_only=True, tag="serial", tag_field="kind"):
    """Force sensor that sends lines of text on a serial port.

    Attributes:
        device: The port; a name under /dev/serial/by-id survives unplugging.
        baud: Bits per second.
        columns: Meaning of each number of a line; "-" for an unused one.
        rate_hz: Samples per second [Hz].
        separator: Text between the numbers; empty for white space.
        start: Command that makes it stream; empty if it streams by itself.
        unit_per_count: Force of one count [`units`].
    """

    device: Annotated[
        str, Meta(pattern=r"^/dev/[^\s]+$", description="such as /dev/serial/by-id/usb-FTDI_...")
    ]
    columns: Columns
    rate_hz: SampleRateHz
    separator: Annotated[str, Meta(max_length=3)] = ","
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


class SimulatedSensor(Section, frozen=True, kw_only=True, tag="simulated", tag_field="kind"):
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

    sensor: SerialSensor | NetFt | SimulatedSensor
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
    """Load a test stand from a YAML file.

    Raises:
        ConfigError: The file is missing, is not such YAML, does not fit, or contradicts itself.
    """
    return strict_yaml.load(path, StandConfig, check=_contradiction)


def _contradiction(test_stand: StandConfig) -> strict_yaml.Problem | None:
    axes = (test_stand.axes.x, test_stand.axes.y, test_stand.axes.z)
    if len({axis[-1] for axis in axes}) < len(axes):
        names = ", ".join(axes)
        return strict_yaml.Problem(
            "axes", f"{names} names an axis of the sensor twice; each belongs to one of x, y, z"
        )
    if not isinstance(test_stand.sensor, SerialSensor):
        return None
    named = [column for column in test_stand.sensor.columns if column != "-"]
    for axis in ("fx", "fy", "fz"):
        if axis not in named:
            return strict_yaml.Problem("sensor.columns", f"no column is {axis}; a force has fx, fy and fz")
    if len(set(named)) < len(named) or len(set(named) & set(NS_PER_TIME_COLUMN_UNIT)) > 1:
        return strict_yaml.Problem("sensor.columns", "name one thing twice; call an unused column -")
    return None
