"""Ways to run a robot that are worth a name: how fast the converters run, how much is averaged, when a force goes out.

What each is worth was measured by `footsense lab tradeoff` on the measured walk of six legs (docs/report, "Latency
against error", where all the others stand too); a test holds the figures here against that page.
"""

from typing import Literal, NamedTuple

from msgspec.structs import replace

from footsense.config.contradictions import first_contradiction
from footsense.config.schema import Config
from footsense.errors import ConfigError

__all__ = ["OPERATING_POINTS", "OperatingPoint", "at_operating_point"]


class OperatingPoint(NamedTuple):
    """A way to run a robot, and what it is worth.

    Attributes:
        rate_sps: Conversions per second, `scan.rate_sps` of the configuration.
        average_scans: Scans that are averaged, `average_scans`.
        publish: When a force goes out, `publish`.
        age_ms: Median age of the measurement behind the force that a consumer holds [ms].
        walk_error_mn: Error of that force on the walk, rms of its length [mN].
        noise_mn: Noise of the force of a foot that stands still, rms of its length [mN].
        purpose: What it is for.
    """

    rate_sps: Literal[100, 200, 400]
    average_scans: int
    publish: Literal["frame", "element"]
    age_ms: float
    walk_error_mn: float
    noise_mn: float
    purpose: str


OPERATING_POINTS = {
    "low-noise": OperatingPoint(
        100, 8, "frame", 423.0, 516.0, 0.13, "weighing and calibrating, feet at rest"
    ),
    "default": OperatingPoint(400, 1, "frame", 26.3, 98.0, 1.22, "walking, the default"),
    "low-latency": OperatingPoint(
        400, 1, "element", 4.6, 32.0, 1.40, "control of a walk, six legs need 1 Mbit/s of CAN"
    ),
}


def at_operating_point(config: Config, name: str) -> Config:
    """Return a configuration with the settings of an operating point instead of its own.

    Args:
        config: The robot.
        name: One of `OPERATING_POINTS`.

    Raises:
        ConfigError: The robot cannot run there.
    """
    point = OPERATING_POINTS[name]
    moved = replace(
        config,
        scan=replace(config.scan, rate_sps=point.rate_sps),
        average_scans=point.average_scans,
        publish=point.publish,
    )
    problem = first_contradiction(moved)
    if problem is not None:
        raise ConfigError(f"operating point {name}: {problem}")
    return moved
