"""What a probe found, as values; `probing` finds it, `probe_complaints` puts into words what is wrong."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from footsense.acquisition.probe.address_scan import AddressScan
from footsense.acquisition.probe.bus_scan import BusScan, ChannelScan
from footsense.acquisition.probe.foot_check import Finding, FootScans
from footsense.config import Bus

__all__ = ["Adapter", "BusReport", "Complaint", "LegReport", "Probed"]


class Complaint(NamedTuple):
    """Something that is wrong.

    Attributes:
        where: The leg, or the device of a bus.
        what: What was found, and what was expected.
        check: What to look at.
    """

    where: str
    what: str
    check: str


class BusReport(NamedTuple):
    """One bus.

    Attributes:
        bus: As configured.
        seen: What is on it.
        claimed: Drivers of the kernel by the addresses that they hold, which were not asked.
    """

    bus: Bus
    seen: BusScan
    claimed: Mapping[int, str]


class LegReport(NamedTuple):
    """One leg.

    Attributes:
        leg: Its name.
        device: Its bus.
        where: Its channel of the mux, or its adapter where the kernel drives that.
        channel: What answers there; None if that could not be looked at.
        scans: Its foot; None if it could not be scanned.
        found: What is wrong with the foot.
    """

    leg: str
    device: str
    where: int | str
    channel: ChannelScan | None
    scans: FootScans | None
    found: tuple[Finding, ...]

    @property
    def unloaded_pf(self) -> list[float] | None:
        """What the configuration may expect of its elements [pF], nine; None if they are not those of a sound foot."""
        if self.scans is None or not all(found.is_fit for found in self.found):
            return None
        mean_pf = self.scans.mean_pf
        return [round(value, 3) for value in mean_pf.tolist()] if np.isfinite(mean_pf).all() else None


class Probed(NamedTuple):
    """What was found.

    Attributes:
        buses: Every bus.
        legs: Every leg, in the order of the configuration.
        complaints: What is wrong, the buses first.
        floor_ns: Nine bare conversions [ns]; 0 without a bus.
    """

    buses: tuple[BusReport, ...]
    legs: tuple[LegReport, ...]
    complaints: tuple[Complaint, ...]
    floor_ns: int

    @property
    def scan_ns(self) -> int | None:
        """Shortest scan that the slowest bus allows [ns]; None if not every bus could be timed, or there is none."""
        timings = [report.seen.timing for report in self.buses]
        known = [timing.limits.scan_ns for timing in timings if timing is not None]
        return max(known) if known and len(known) == len(timings) else None


class Adapter(NamedTuple):
    """An adapter of which no configuration tells.

    Attributes:
        device: Its device file.
        addresses: Who answers on it; None if a line is held, or it cannot be opened.
        claimed: As in `BusReport`.
        error: Why there is no addresses.
    """

    device: str
    addresses: AddressScan | None
    claimed: Mapping[int, str]
    error: str = ""
