"""Data types of the result of a probe."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from footsense.acquisition.leg_connection import ChipTiming
from footsense.acquisition.probe.bus_scan import BusScan, ChannelScan
from footsense.acquisition.probe.foot_check import FootFault, FootScans
from footsense.config.sections import Bus


class Diagnosis(NamedTuple):
    """One fault of a bus or leg, as text: location, observation, advice.

    Attributes:
        location: Leg, or device of a bus.
        observation: Observation, and what was expected.
        advice: What to check.
    """

    location: str
    observation: str
    advice: str


class ProbedBus(NamedTuple):
    """Probe result of one I2C bus.

    Attributes:
        bus_config: Its configuration.
        scan: Addresses, mux, channels and timing found on it.
        kernel_drivers: Kernel drivers by the address that each holds; those addresses were not scanned.
    """

    bus_config: Bus
    scan: BusScan
    kernel_drivers: Mapping[int, str]


class ProbedLeg(NamedTuple):
    """Probe result of one leg: chips, readings, faults.

    Attributes:
        leg: Name of the leg.
        device: Device of its bus.
        channel: Channel of the mux; None without one.
        chips: Chips that answer there; None if they could not be scanned.
        timing: Timing of its converter; None if it was not measured.
        scans: Scans of its foot; None if there are none.
        faults: Faults of the foot.
    """

    leg: str
    device: str
    channel: int | None
    chips: ChannelScan | None
    timing: ChipTiming | None
    scans: FootScans | None
    faults: tuple[FootFault, ...]

    @property
    def unloaded_pf(self) -> list[float] | None:
        """Mean reading of each element, for `unloaded_pf` of the configuration [pF]; None for a faulty foot."""
        if self.scans is None or not all(fault.foot_may_be_sound for fault in self.faults):
            return None
        mean_pf = self.scans.mean_pf
        return [round(value, 3) for value in mean_pf.tolist()] if np.isfinite(mean_pf).all() else None


class ProbeResult(NamedTuple):
    """Result of a probe: buses, legs, diagnoses.

    Attributes:
        buses: Every bus.
        legs: Every leg, in the order of the configuration.
        diagnoses: Faults, those of the buses first.
        scan_conversion_time_ns: Time of the conversions of a scan without any transaction [ns]; 0 without a bus.
    """

    buses: tuple[ProbedBus, ...]
    legs: tuple[ProbedLeg, ...]
    diagnoses: tuple[Diagnosis, ...]
    scan_conversion_time_ns: int

    @property
    def scan_period_bound_ns(self) -> int | None:
        """Shortest scan period of the slowest bus [ns]; None without a bus, or if one could not be timed."""
        timings = [report.scan.bus_timing for report in self.buses]
        known_ns = [timing.lower_bounds.scan_period_bound_ns for timing in timings if timing is not None]
        return max(known_ns) if known_ns and len(known_ns) == len(timings) else None
