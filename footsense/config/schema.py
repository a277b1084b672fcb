"""Schema of the configuration file as a whole, and values derived from it."""

import math
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct

from firmware_interface.chips import fdc1004
from footsense.acquisition.boards import ad7147
from footsense.acquisition.mcu_source import Serial
from footsense.acquisition.scan_plan import (
    AD7147_PLAN,
    FASTEST_SPS,
    AnyPlan,
    Scan,
    ScanPlan,
    scan_plan,
)
from footsense.can.interface import Can
from footsense.config import sections
from footsense.estimation.settings import MAX_AGE_SCANS, ContactLimits, TareLimits
from footsense.foot.calibration_files import FootId
from footsense.frames import Leg

#: Boards that are gone, and the last commit that knows each.
_GONE_BOARDS = {"ad7746": "27dcc809", "fdc1004_columns": "0e63fae9"}

#: Most forces a second of a leg on CAN by default: with all other frames 36 % of 500 kbit/s for six legs.
_DEFAULT_FORCES_HZ = 100.0


class Config(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Configuration of the daemon, as parsed from a YAML file.

    Attributes:
        board: Electronics of a foot.
        buses: I2C adapters; none with board `mcu`.
        serial: Line to the microcontroller; with board `mcu` only.
        can: CAN channel for the forces. No default: a robot whose forces stay in the process would look healthy.
        scan: Rate of the conversions.
        publish_every: Frames of readings (conversions, with board `ad7147` scans) per force on CAN; a
            change of a leg's state is sent at once. None for at most 100 forces a second; with board `mcu` every record
            is sent.
        tare: Conditions for a tare.
        baseline: Tracking of the baseline between tares.
        contact: Contact detection.
        max_age_ms: Age of its oldest element at which a measurement becomes `stale` [ms]; None for four scans.
        stray_pf: Capacitance of the wiring beside each element [pF], one for each element of a leg; 0 where absent. A
            foot's calibration has its own.
        unloaded_pf: Reading of each element of the mounted, unloaded foot, stray included [pF], one for each element of
            a leg; the design's if absent. A tare has to be near it. A foot's calibration has its own.
        foot_type: Name of a released foot type, or, with a slash, the folder of another from `footsense lab build`,
            relative to the file. The folder has the name of the type.
        model: Network to use, relative to the file; None for that of the foot type.
        feet: Foot mounted on each leg.
        calibrations: Folder of the feet's calibrations, relative to the file; every foot in `feet` needs one there, or
            an entry in `unloaded_pf`, by which it is read as designed until it has one. A calibration brings stray_pf,
            unloaded_pf and network. None assumes the foot as designed.
        ring: File in memory through which the service hands the cycles of the last 30 s to its readers; None for
            /run/footsense/ring, and in a simulation for one of the user's own.
        metrics: Where the metrics are served.
        view: Where the page is served.
        realtime: Scheduling to request; None for none.
    """

    board: Literal["ad7147", "fdc1004", "mcu"] = "ad7147"
    buses: Annotated[tuple[sections.Bus, ...], Meta(max_length=8)] = ()
    serial: Serial | None = None
    can: Annotated[Can, Meta(description="interface: socketcan, channel: can0 on a robot")]
    scan: Scan = Scan()
    publish_every: Annotated[int, Meta(ge=1, le=36)] | None = None
    tare: TareLimits = TareLimits()
    baseline: sections.BaselineTracking = sections.BaselineTracking()
    contact: ContactLimits = ContactLimits()
    max_age_ms: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    stray_pf: dict[Leg, sections.StrayPf] = {}
    unloaded_pf: dict[Leg, sections.UnloadedPf] = {}
    foot_type: Annotated[
        str,
        Meta(
            pattern=r"^(.*/[a-z0-9][a-z0-9-]{0,39}|[A-Za-z0-9][\w-]{0,39})$",
            description="such as aoyagi-3x3, or ./models/my-foot for a folder",
        ),
    ] = "aoyagi-3x3"
    model: Annotated[str, Meta(min_length=1)] | None = None
    feet: dict[Leg, FootId] = {}
    calibrations: Annotated[str, Meta(min_length=1)] | None = None
    ring: Annotated[str, Meta(min_length=1)] | None = None
    metrics: sections.Metrics = sections.Metrics()
    view: sections.PageServer = sections.PageServer()
    realtime: sections.Realtime | None = None

    @property
    def legs(self) -> tuple[str, ...]:
        """Names of the configured legs, bus by bus: the rows of every frame."""
        if self.serial is not None:
            return self.serial.legs
        return tuple(leg for bus in self.buses for leg in bus.channels)

    @property
    def ring_path(self) -> Path | None:
        """The configured ring; None for where it is by default."""
        return None if self.ring is None else Path(self.ring)

    @property
    def frames_hz(self) -> float:
        """Capacitance frames per second: conversions, scans of converters that run freely, records of `mcu`."""
        if self.serial is not None:
            return self.serial.rate_hz
        return self.rate_sps if isinstance(self.scan_plan, ScanPlan) else 1e3 / self.shortest_scan_ms

    @property
    def shortest_scan_ms(self) -> float:
        """Shortest duration of a scan [ms]: of all conversions, or the microcontroller's period."""
        if self.serial is not None:
            return 1e3 / self.serial.rate_hz
        return self.scan_plan.n_conversions * self.conversion_rate.conversion_ns * 1e-6

    @property
    def effective_publish_every(self) -> int:
        """Number of capacitance frames per force sent on CAN."""
        if self.serial is not None:
            return 1
        return self.publish_every or math.ceil(self.frames_hz / _DEFAULT_FORCES_HZ)

    @property
    def forces_hz(self) -> float:
        """Rate at which each leg's forces are sent on CAN while no state changes [Hz]."""
        return self.frames_hz / self.effective_publish_every

    @property
    def rate_sps(self) -> int:
        """Conversions per second of one converter."""
        return self.scan.rate_sps or FASTEST_SPS

    @property
    def conversion_rate(self) -> fdc1004.Fdc1004Rate | ad7147.Ad7147Rate:
        """Conversion time and noise at the configured rate; of board `mcu`, whose converters are unknown, the same."""
        return ad7147.RATE if self.board == "ad7147" else fdc1004.RATES[self.rate_sps]

    @property
    def scan_plan(self) -> AnyPlan:
        """Plan of a scan of feet that are read over I2C."""
        return AD7147_PLAN if self.board == "ad7147" else self.triggered_plan

    @property
    def triggered_plan(self) -> ScanPlan:
        """Plan of a scan of board `fdc1004`, whose conversions are triggered."""
        return scan_plan(self.rate_sps)

    @property
    def effective(self) -> dict[str, object]:
        """Settings that depend on others, by their keys, with the values in use."""
        values: dict[str, object] = {
            "publish_every": self.effective_publish_every,
            "max_age_ms": self.effective_max_age_ms,
        }
        if self.board == "fdc1004":
            values["scan"] = {"rate_sps": self.rate_sps}
        return values

    @property
    def effective_max_age_ms(self) -> float:
        """Age limit of a measurement [ms]: the configured one, or four scans."""
        if self.max_age_ms is not None:
            return self.max_age_ms
        return MAX_AGE_SCANS * self.shortest_scan_ms


def gone_board(config: object) -> str | None:
    """Return that the board of a configuration is gone, and the last commit that knows it; None if it is not.

    Args:
        config: The configuration as plain data.
    """
    board = config.get("board") if isinstance(config, dict) else None
    if not isinstance(board, str) or board not in _GONE_BOARDS:
        return None
    return f"the board {board} is gone; the last commit that knows it is {_GONE_BOARDS[board]}"
