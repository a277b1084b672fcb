"""Named operating points: combinations of conversion rate and publishing interval.

Measured by `footsense lab tradeoff` on the measured walk of six legs (docs/report, "Latency against error", with all
other settings); a test compares the figures here with that page.
"""

from typing import Literal, NamedTuple

from msgspec.structs import replace

from footsense.config.contradictions import first_contradiction
from footsense.config.schema import Config
from footsense.errors import ConfigError


class OperatingPoint(NamedTuple):
    """Conversion rate and publishing interval, with the force age, force error and noise measured with them.

    Attributes:
        rate_sps: Conversions per second, `scan.rate_sps` of the configuration.
        publish_every: Conversions per force, `publish_every`.
        median_force_age_ms: Median age of the measurement behind the force in use by a consumer [ms].
        walk_force_rmse_mn: Error of that force on the walk, rms of its length [mN].
        noise_mn: Noise of the force of a foot at rest, rms of its length [mN].
        purpose: Use of the operating point.
    """

    rate_sps: Literal[100, 200, 400]
    publish_every: int
    median_force_age_ms: float
    walk_force_rmse_mn: float
    noise_mn: float
    purpose: str


OPERATING_POINTS = {
    "low-noise": OperatingPoint(100, 4, 28.9, 129.1, 0.34, "weighing and calibrating, feet at rest"),
    "default": OperatingPoint(400, 4, 8.7, 30.6, 0.70, "walking, the default"),
    "low-latency": OperatingPoint(
        400, 1, 4.6, 19.9, 0.70, "control of a walk, six legs need 1 Mbit/s of CAN"
    ),
}


def at_operating_point(config: Config, name: str) -> Config:
    """Return a configuration with the conversion rate and publishing interval of an operating point.

    Args:
        config: The robot.
        name: One of `OPERATING_POINTS`.

    Raises:
        ConfigError: The settings contradict others of the robot.
    """
    point = OPERATING_POINTS[name]
    moved = replace(
        config,
        scan=replace(config.scan, rate_sps=point.rate_sps),
        publish_every=point.publish_every,
    )
    problem = first_contradiction(moved)
    if problem is not None:
        raise ConfigError(f"operating point {name}: {problem}")
    return moved
