"""What is on the configured buses: everything that is to be known before a first walk."""

from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np

from footsense.acquisition.linux_i2c import LinuxI2cBus, adapters, kernel_drivers
from footsense.acquisition.probe.address_scan import take_census
from footsense.acquisition.probe.bus_scan import Place, look_at_adapters, look_at_bus
from footsense.acquisition.probe.foot_check import Finding, FootScans, findings
from footsense.acquisition.scan_plan import ScanPlan
from footsense.acquisition.upstream_bus import Trunk
from footsense.config import Config
from footsense.daemon.acquisition import open_buses, plan_for, scanning, simulated_robot
from footsense.daemon.estimation import load_network
from footsense.daemon.probe.findings import bus_complaints, leg_complaints
from footsense.daemon.probe.report import Adapter, BusReport, Complaint, LegReport, Probed
from footsense.errors import HardwareError
from footsense.frames import ELEMENTS, Reading
from footsense.sim.scene import Scene

__all__ = ["adapters_seen", "probe"]

#: Scans of which noise is taken: their standard deviation is then known to a sixth.
_N_SCANS = 20
#: Before them, converters that were just set up may still settle, and legs that fail are left out.
_N_SETTLING = 4
#: A foot behind such readings is not known.
_SILENT = (Reading.NO_ANSWER, Reading.BUS_STUCK, Reading.WRONG_CHIP)


def adapters_seen() -> list[Adapter]:
    """Return who answers on every adapter of this computer; nothing is written to anyone.

    Raises:
        HardwareError: There is none.
    """
    found = [_adapter_seen(device) for device in adapters()]
    if not found:
        raise HardwareError(
            "no I2C adapter: there is no /dev/i2c-*; enable I2C (on a Raspberry Pi dtparam=i2c_arm=on, and the module "
            "i2c-dev), or probe a simulated robot with --scene hanging"
        )
    return found


def _adapter_seen(device: str) -> Adapter:
    claimed = kernel_drivers(device)
    try:
        bus = LinuxI2cBus.open(device)
    except HardwareError as error:
        return Adapter(device, None, claimed, str(error))
    try:
        return Adapter(device, take_census(bus, claimed), claimed)
    except HardwareError as error:
        return Adapter(device, None, claimed, str(error))
    finally:
        bus.close()


def probe(config: Config, scene: Scene | None) -> Probed:
    """Look at every bus, then scan the feet some times; they have to hang in the air.

    Args:
        config: The robot.
        scene: What it does if its buses are to be simulated; None for its real buses.

    Raises:
        HardwareError: An adapter is not there.
        ModelError: The network that tells what a foot reads, or a simulated foot's table, is missing.
    """
    buses: tuple[BusReport, ...] = ()
    complaints: list[Complaint] = []
    floor_ns = 0
    if config.buses:  # a microcontroller's are its own
        plan = plan_for(config)
        buses = tuple(_buses_seen(config, scene, plan))
        complaints += [complaint for report in buses for complaint in bus_complaints(report, plan)]
        floor_ns = ELEMENTS * plan.conversion_ns
    scanned = None
    if all(report.seen.mux_answers for report in buses):
        try:
            scanned = _scanned(config, scene)
        except HardwareError as error:
            complaints.append(Complaint("scan", str(error), "this first: no foot was scanned"))
    legs = tuple(_legs_seen(config, buses, scanned))
    complaints += [complaint for leg in legs for complaint in leg_complaints(leg)]
    return Probed(buses, legs, tuple(complaints), floor_ns)


def _buses_seen(config: Config, scene: Scene | None, plan: ScanPlan) -> Iterator[BusReport]:
    """Look at one bus after the other.

    Yields:
        What is on each.
    """
    robot = None if scene is None else simulated_robot(config, scene)
    with ExitStack() as stack:
        for opened in open_buses(config, robot, stack):
            bus = opened.bus
            claimed = kernel_drivers(bus.device) if robot is None else {}
            if opened.trunk is None:
                seen = look_at_adapters(opened.adapters, opened.clock, plan, claimed)
            else:
                trunk = Trunk(opened.trunk, bus.mux.address, opened.reset_line)
                seen = look_at_bus(trunk, opened.clock, plan, bus.channels, claimed)
            yield BusReport(bus, seen, claimed)


def _scanned(config: Config, scene: Scene | None) -> list[FootScans]:
    """Return some scans of the foot on each leg."""
    with scanning(config, scene) as started:
        frames = [started.source.read() for _ in range(_N_SETTLING + _N_SCANS)][_N_SETTLING:]
    capacitance_pf = np.stack([frame.capacitance_pf for frame in frames], axis=1)
    reading = np.stack([frame.reading for frame in frames], axis=1)
    return [FootScans(*of_leg) for of_leg in zip(capacitance_pf, reading, strict=True)]


def _legs_seen(
    config: Config, buses: tuple[BusReport, ...], scanned: list[FootScans] | None
) -> Iterator[LegReport]:
    """Judge one leg after the other.

    Yields:
        What is known of each, in the order of the configuration.
    """
    rest_pf = load_network(config).card.trained_inputs.design.rest_pf
    for number, (leg, device, where, place) in enumerate(_places(config, buses)):
        scans = scanned[number] if scanned is not None else None
        if scans is not None and np.isin(scans.reading, _SILENT).all():
            scans = None
        # What a loose contact spoils says nothing of the foot.
        found = () if scans is None or scans.is_intermittent else _found(config, leg, scans, rest_pf)
        yield LegReport(leg, device, where, place, scans, found)


def _places(
    config: Config, buses: tuple[BusReport, ...]
) -> Iterator[tuple[str, str, int | str, Place | None]]:
    """Tell where each leg is, in the order of the configuration.

    Yields:
        Its name, its bus or line, its channel or adapter there, and what answers.
    """
    for report in buses:
        for number, (leg, where) in enumerate(report.bus.legs.items()):
            place = report.seen.places.get(where if isinstance(where, int) else number)
            yield leg, report.bus.device, where, place
    if config.serial is not None:
        for name in config.legs:
            yield name, config.serial.device, "mcu", None


def _found(config: Config, leg: str, scans: FootScans, rest_pf: float) -> tuple[Finding, ...]:
    stray_pf = np.array(config.stray_pf.get(leg, (0.0,) * ELEMENTS))  # type: ignore[call-overload]
    expected_pf = config.unloaded_pf.get(leg)  # type: ignore[call-overload]
    return findings(
        scans,
        stray_pf,
        np.full(ELEMENTS, rest_pf) if expected_pf is None else np.array(expected_pf) - stray_pf,
        noise_limit_ff=config.tare.noise_limit_ff,
        unloaded_limit_rel=config.tare.unloaded_limit_rel,
    )
