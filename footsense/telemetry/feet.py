"""Metrics of the feet themselves: which they are, and an odometer of each that survives restarts.

The exporter counts them from the cycles that it reads, so that the loop knows nothing of them; what no exporter saw is
not in them. Feet wear: what a foot has been through stays with its name, on whichever leg it is.
"""

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from footsense.frames import Cause, Cycle, Flag, GaitEventKind
from footsense.regular_file import read_regular, write_whole
from footsense.ring.records import leg_entries

_log = logging.getLogger(__name__)

#: Where the unit of `footsense exporter` keeps the odometers.
ODOMETER_FILE = Path("/var/lib/footsense/odometer/feet.json")
#: Time between two writes of the file, on the service's clock: what a power cut may cost [ns].
SAVE_PERIOD_NS = 300_000_000_000
#: Longest time between two cycles that counts [ns]: a longer one was not seen.
_MAX_GAP_NS = 1_000_000_000
_MAX_FILE_BYTES = 1 << 20

_Total = Annotated[float, msgspec.Meta(ge=0.0)]


class FootTotals(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a foot has been through.

    Attributes:
        steps: Touchdowns.
        contact_s: Time in contact with the ground [s].
        peak_force_n: Largest force [N].
        over_range_s: Time with elements loaded beyond their range [s].
    """

    steps: _Total = 0.0
    contact_s: _Total = 0.0
    peak_force_n: _Total = 0.0
    over_range_s: _Total = 0.0


class _OdometerFile(msgspec.Struct, forbid_unknown_fields=True):
    footsense: Literal["odometer"]
    feet: dict[str, FootTotals]


class _RecordedConfig(msgspec.Struct):
    board: str = ""


def identity_metrics(header: Mapping[str, str], legs: Sequence[str]) -> Iterator[Metric]:
    """Yield what a service and its feet are, by the header of its ring.

    Yields:
        One metric of each name.
    """
    robot = _RecordedConfig()
    with suppress(msgspec.MsgspecError, RecursionError):
        robot = msgspec.json.decode(header.get("config", ""), type=_RecordedConfig)
    service = {
        "version": header.get("footsense", ""),
        "board": robot.board,
        "foot_type": header.get("foot_type", ""),
        "network": header.get("model_sha256", "")[:12],
    }
    meaning = "1; version, board, foot type and network of the service."
    info = GaugeMetricFamily("footsense_info", meaning, labels=list(service))
    info.add_metric(list(service.values()), 1.0)
    yield info
    meaning = "1; the foot on the leg, and its calibration in use; empty without."
    info = GaugeMetricFamily("footsense_foot_info", meaning, labels=["leg", "foot", "calibration"])
    feet, calibrations = leg_entries(header, "feet"), leg_entries(header, "calibrations")
    for leg in legs:
        info.add_metric([leg, feet.get(leg, ""), calibrations.get(leg, "")[:12]], 1.0)
    yield info


class Odometer:
    """Odometers of the feet of one service after the other; those of simulated feet are kept nowhere.

    Args:
        path: File in which they are kept; need not exist.
    """

    def __init__(self, path: Path = ODOMETER_FILE) -> None:
        self._path, self._is_kept, self._is_told = path, False, False
        self._legs: tuple[str, ...] = ()
        self._feet: list[str] = []
        self._known: dict[str, FootTotals] = {}
        self._last_ns = self._saved_ns = 0
        self._totals = np.zeros((4, 0))

    def begin(self, header: Mapping[str, str], legs: Sequence[str]) -> None:
        """Begin with a service, by the header of its ring, with what is known of its feet."""
        self._legs = tuple(legs)
        feet = leg_entries(header, "feet")
        self._feet = [feet.get(leg) or leg for leg in legs]
        self._is_kept = not header.get("scene")
        self._known = self._read() if self._is_kept else {}
        known = [msgspec.structs.astuple(self._known.get(foot, FootTotals())) for foot in self._feet]
        self._totals = np.array(known).T.copy()
        self._last_ns = self._saved_ns = 0

    def _read(self) -> dict[str, FootTotals]:
        """Return what the file has; one that is none is set aside."""
        try:
            return msgspec.json.decode(read_regular(self._path, _MAX_FILE_BYTES), type=_OdometerFile).feet
        except (FileNotFoundError, NotADirectoryError):
            return {}
        except (OSError, ValueError, msgspec.MsgspecError, RecursionError) as error:
            aside = self._path.with_suffix(".json.old")
            with suppress(OSError):
                self._path.replace(aside)
            why = error.strerror if isinstance(error, OSError) else error
            _log.warning("%s: no odometers: %s; they begin at zero, it is kept as %s", self._path, why, aside)
            return {}

    def add(self, cycle: Cycle) -> None:
        """Count one cycle."""
        forces = cycle.forces
        steps, contact_s, peak_n, over_range_s = self._totals
        gap_ns = forces.t_sent_ns - self._last_ns if self._last_ns else 0
        self._last_ns = forces.t_sent_ns
        self._saved_ns = self._saved_ns or self._last_ns
        if 0 < gap_ns <= _MAX_GAP_NS:
            contact_s += 1e-9 * gap_ns * (forces.flags & Flag.CONTACT != 0)
            over_range_s += 1e-9 * gap_ns * (forces.cause == Cause.OVERLOAD)
        np.fmax(peak_n, np.sqrt((forces.force_n**2).sum(axis=1)), out=peak_n)
        for event in forces.gait.events if forces.gait is not None else ():
            steps[event.leg] += event.kind == GaitEventKind.TOUCHDOWN

    def save(self, *, now: bool = True) -> None:
        """Write the file if anything has changed; unless it is to be now, not before its time has come."""
        if not self._is_kept or (not now and self._last_ns - self._saved_ns < SAVE_PERIOD_NS):
            return
        self._saved_ns = self._last_ns
        rows = self._totals.T.tolist()
        known = self._known | {foot: FootTotals(*row) for foot, row in zip(self._feet, rows, strict=True)}
        if known == self._known:
            return
        try:
            write_whole(
                self._path, msgspec.json.format(msgspec.json.encode(_OdometerFile("odometer", known)))
            )
        except OSError as error:
            if not self._is_told:
                _log.warning("%s: the odometers cannot be kept: %s", self._path, error.strerror)
            self._is_told = True
        else:
            self._known, self._is_told = known, False

    def collect(self) -> Iterator[Metric]:
        """Yield the odometers.

        Yields:
            One metric of each name.
        """
        for (name, meaning), totals in zip(_METRICS, self._totals.tolist(), strict=True):
            kind = CounterMetricFamily if name.endswith("_total") else GaugeMetricFamily
            metric = kind(name, meaning, labels=["leg", "foot"])
            for leg, foot, total in zip(self._legs, self._feet, totals, strict=True):
                metric.add_metric([leg, foot], total)
            yield metric


#: Name and meaning of the metric of each total.
_METRICS = (
    ("footsense_foot_steps_total", "Touchdowns of a foot."),
    ("footsense_foot_contact_seconds_total", "Time of a foot in contact with the ground."),
    ("footsense_foot_peak_force_newtons", "Largest force on a foot."),
    ("footsense_foot_over_range_seconds_total", "Time with elements loaded beyond their range."),
)
