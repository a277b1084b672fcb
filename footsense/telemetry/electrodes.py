"""Metrics of what `footsense selfcal` says of the feet's electrodes, from its states."""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import msgspec
from prometheus_client.core import GaugeMetricFamily, Metric

from footsense.regular_file import read_regular

#: Where the unit of `footsense selfcal` keeps its states.
STATE_FOLDER = Path("/var/lib/footsense/selfcal")


class _Of(msgspec.Struct):
    leg: str


class ElectrodesSeen(msgspec.Struct):
    """What a metric needs of a state of `footsense selfcal`.

    Attributes:
        of: What it is of.
        turn_deg: By how much the electrodes turn forces against those in use [deg]; None before a fit.
        turn_sigma_deg: Standard deviation of it [deg].
        objection: Why they are not proposed as a calibration; empty if they are.
    """

    of: _Of
    turn_deg: float | None
    turn_sigma_deg: float | None
    objection: str


def seen_electrodes(folder: Path) -> list[ElectrodesSeen]:
    """Return what the states in a folder say; those that cannot be read are left out."""
    found = []
    for path in sorted(folder.glob("*.json")):
        with suppress(OSError, msgspec.MsgspecError):
            found.append(msgspec.json.decode(read_regular(path), type=ElectrodesSeen))
    return found


def electrode_metrics(seen: Sequence[ElectrodesSeen]) -> Iterator[Metric]:
    """Yield the metrics of the electrodes of some feet.

    Yields:
        One metric of each name; none without feet.
    """
    gauges = [
        GaugeMetricFamily(name, meaning, labels=["leg"])
        for name, meaning in (
            (
                "footsense_electrodes_turned_radians",
                "Turn of the forces by changed electrodes; NaN before a fit.",
            ),
            ("footsense_electrodes_turned_sigma_radians", "Standard deviation of it; NaN before a fit."),
            ("footsense_calibration_proposed", "1 while nothing speaks against a calibration by walking."),
        )
    ]
    for foot in seen:
        turned = [
            math.nan if deg is None else math.radians(deg) for deg in (foot.turn_deg, foot.turn_sigma_deg)
        ]
        proposed = float(foot.turn_deg is not None and not foot.objection)
        for gauge, value in zip(gauges, [*turned, proposed], strict=True):
            gauge.add_metric([foot.of.leg], value)
    if seen:
        yield from gauges
