"""Probe the configured buses and unloaded feet."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from footsense.acquisition.bus_scan import ChannelScan, scan_bus
from footsense.acquisition.foot_check import FootFault, FootScans, foot_faults
from footsense.acquisition.leg_connection import ChipTiming
from footsense.acquisition.linux_i2c import kernel_drivers
from footsense.acquisition.scan_plan import ScanPlan
from footsense.acquisition.scanner import RobotScanner
from footsense.config import Config
from footsense.daemon.acquisition import open_buses, open_scan_source, scan_plan_for
from footsense.daemon.diagnosis import (
    Diagnosis,
    ProbedBus,
    ProbedLeg,
    ProbeResult,
    bus_diagnoses,
    leg_diagnoses,
)
from footsense.daemon.estimation import mounted_feet
from footsense.daemon.models import load_models
from footsense.daemon.simulation import simulated_robot
from footsense.errors import HardwareError
from footsense.frames import ELEMENTS
from footsense.leg_words import SILENT_READINGS
from footsense.sim.scene import Scene

#: Scans for the noise: they give its standard deviation to a sixth.
_N_FOOT_SCANS = 20
#: Scans before them: converters that were just set up may still settle, and legs that fail are left out.
_N_DISCARDED_SCANS = 4


def probe(config: Config, scene: Scene | None) -> ProbeResult:
    """Scan every bus for chips, read the unloaded feet a few times, and return the result with diagnoses.

    Args:
        config: The robot.
        scene: Scene of its simulation; None for its real buses.

    Raises:
        HardwareError: An adapter is missing.
        ModelError: The network, for the expected readings, or a simulated foot's response table is missing.
    """
    buses: tuple[ProbedBus, ...] = ()
    diagnoses: list[Diagnosis] = []
    conversions_ns = 0
    if config.buses:  # a microcontroller has its own buses
        plan = scan_plan_for(config)
        buses = tuple(_probe_buses(config, scene, plan))
        diagnoses += [diagnosis for report in buses for diagnosis in bus_diagnoses(report, plan)]
        conversions_ns = ELEMENTS * plan.conversion_ns
    feet, timings = None, None
    if all(report.scan.mux_answers for report in buses):
        try:
            feet, timings = _scan_feet(config, scene)
        except HardwareError as error:
            diagnoses.append(Diagnosis("scan", str(error), "this first: no foot was scanned"))
    legs = tuple(_probed_legs(config, buses, feet, timings))
    diagnoses += [diagnosis for leg in legs for diagnosis in leg_diagnoses(leg)]
    return ProbeResult(buses, legs, tuple(diagnoses), conversions_ns)


def _probe_buses(config: Config, scene: Scene | None, plan: ScanPlan) -> Iterator[ProbedBus]:
    """Yield the scan result of every bus."""
    robot = None if scene is None else simulated_robot(config, scene)
    with ExitStack() as stack:
        for opened in open_buses(config, robot, stack):
            bus = opened.bus_config
            drivers = kernel_drivers(bus.device) if robot is None else {}
            scan = scan_bus(opened.legs, opened.clock, plan, bus.channels, drivers)
            yield ProbedBus(bus, scan, drivers)


def _scan_feet(config: Config, scene: Scene | None) -> tuple[list[FootScans], list[ChipTiming | None] | None]:
    """Return the readings of each foot over some scans, and its converter's timing; None with a microcontroller."""
    with open_scan_source(config, scene) as started:
        frames = started.read_whole_scans(_N_DISCARDED_SCANS + _N_FOOT_SCANS)[_N_DISCARDED_SCANS:]
        timings = None
        if isinstance(started.source, RobotScanner):
            timings = [leg.timing if leg.is_timed else None for leg in started.source.legs]
    capacitance_pf = np.stack([frame.capacitance_pf for frame in frames], axis=1)
    reading = np.stack([frame.reading for frame in frames], axis=1)
    return [FootScans(*of_leg) for of_leg in zip(capacitance_pf, reading, strict=True)], timings


def _probed_legs(
    config: Config,
    buses: tuple[ProbedBus, ...],
    feet: list[FootScans] | None,
    timings: list[ChipTiming | None] | None,
) -> Iterator[ProbedLeg]:
    """Yield the result of every leg, in the order of the configuration."""
    leg_channels: list[tuple[str, str, int | None, ChannelScan | None]] = []
    for report in buses:
        bus = report.bus_config
        for leg, channel in bus.channels.items():
            on_mux = None if bus.mux_address is None else channel
            leg_channels.append((leg, bus.device, on_mux, report.scan.channels.get(channel)))
    if config.serial is not None:
        leg_channels = [(name, config.serial.device, None, None) for name in config.legs]
    # By the configuration and the design alone, without the calibrations.
    known = mounted_feet(replace(load_models(config), calibrations_by_leg={}))
    for row, place in enumerate(leg_channels):
        scans = None if feet is None or np.isin(feet[row].reading, SILENT_READINGS).all() else feet[row]
        faults: tuple[FootFault, ...] = ()
        if (
            scans is not None and not scans.chips_fail_intermittently
        ):  # readings lost by a loose contact say nothing of the foot
            faults = foot_faults(
                scans,
                known.stray_pf[row],
                known.unloaded_pf[row],
                noise_limit_ff=config.tare.noise_limit_ff,
                unloaded_limit_rel=config.tare.unloaded_limit_rel,
            )
        yield ProbedLeg(*place, timings[row] if timings else None, scans, faults)
