"""Probe of the configured buses and unloaded feet: what is found, and faults as text: where, what, what to check."""

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from footsense.acquisition.boards.chip_timing import ChipTiming
from footsense.acquisition.bus_scan import (
    BusScan,
    LegScan,
    TimeLimitedBus,
    leg_chip_addresses,
    scan_bus,
)
from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.linux_i2c import kernel_drivers
from footsense.acquisition.mcu_source import McuSource
from footsense.acquisition.scan_plan import AnyPlan, ScanPlan
from footsense.config import Config
from footsense.config.sections import Bus
from footsense.daemon.acquisition import MIN_BUS_SPEED_REL, open_buses, open_scan_source
from footsense.daemon.estimation import mounted_feet
from footsense.daemon.models import load_models
from footsense.daemon.setup.foot_check import CHIP_FAULT_READINGS, FootFault, FootScans, foot_faults
from footsense.daemon.simulation import simulated_robot
from footsense.errors import HardwareError, I2cError, I2cTimeoutError, NackError
from footsense.estimation.noise import NOISE_SAMPLES
from footsense.estimation.settings import LONG_SILENCE_NS
from footsense.estimation.tare import SETTLING_SCANS
from footsense.frames import Reading
from footsense.leg_words import IS_SILENT, words_of_reading
from footsense.ports import Clock, I2cBus, Transaction
from footsense.sim.scene import Scene

#: Addresses that a TCA9548A may be strapped to.
MUX_ADDRESSES = range(0x70, 0x78)


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
        n_repeated: Transactions that passed only when they were repeated: with the mux, or after a time-out.
        failure: Why the scan was given up; empty if it was not.
    """

    bus_config: Bus
    scan: BusScan
    kernel_drivers: Mapping[int, str]
    n_repeated: int = 0
    failure: str = ""


class ProbedLeg(NamedTuple):
    """Probe result of one leg: chips, readings, faults.

    Attributes:
        leg: Name of the leg.
        device: Device of its bus.
        channel: Channel of the mux; None without one.
        address: Address of its converter; None unless the board is `ad7147`.
        chips: Chips that answer there; None if they could not be scanned.
        timing: Timing of its converter; None if it was not measured.
        scans: Scans of its foot; None if there are none.
        faults: Faults of the foot.
    """

    leg: str
    device: str
    channel: int | None
    address: int | None
    chips: LegScan | None
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
    """

    buses: tuple[ProbedBus, ...]
    legs: tuple[ProbedLeg, ...]
    diagnoses: tuple[Diagnosis, ...]

    @property
    def scan_period_bound_ns(self) -> int | None:
        """Shortest scan period of the slowest bus [ns]; None without a bus, or if one could not be timed."""
        timings = [report.scan.bus_timing for report in self.buses]
        known_ns = [timing.lower_bounds.scan_period_bound_ns for timing in timings if timing is not None]
        return max(known_ns) if known_ns and len(known_ns) == len(timings) else None


def bus_diagnoses(report: ProbedBus, plan: AnyPlan) -> Iterator[Diagnosis]:
    """Yield the faults that concern a whole bus."""
    device = report.bus_config.device
    loose = "plugs and cables, pull-ups, and the supply of the mux: a loose contact"
    if report.n_repeated:
        now_and_then = "passed only when repeated: its lines or its mux fail now and then"
        yield Diagnosis(device, f"{report.n_repeated} transactions {now_and_then}", loose)
    if report.failure:
        yield Diagnosis(device, report.failure, loose)
        return
    for observation, advice in _bus_faults(report, plan):
        yield Diagnosis(device, observation, advice)


def _bus_faults(report: ProbedBus, plan: AnyPlan) -> Iterator[tuple[str, str]]:
    """Yield observation and advice for each fault of a bus."""
    bus, scan, drivers = report[:3]
    if scan.upstream is None and bus.mux_address is None:
        yield (
            f"SDA or SCL is held low, by any of {', '.join(bus.channels)} or by the wires before them",
            "short in a cable or plug, pull-ups, and whether all chips have power; unplug one foot after the other",
        )
        return
    if scan.upstream is None:
        needs_wire = not bus.mux.reset
        wire = "; only the mux's RESET pin frees a leg that holds it: wire one" if needs_wire else ""
        yield (
            "SDA or SCL is held low on the upstream bus, and the mux cannot free it",
            f"short, missing pull-ups or an unpowered chip upstream of the mux{wire}",
        )
        return
    for address in leg_chip_addresses(plan):
        if bus.mux_address is not None and address in (*scan.upstream.answering, *drivers):
            yield (
                f"something answers at {address:#04x} with no leg connected: a chip of every leg has that address",
                "what it is; move it to another address or another bus",
            )
    if not scan.mux_answers:
        yield _missing_mux_fault(report)
    if scan.bus_timing is not None and scan.bus_timing.bus_hz < MIN_BUS_SPEED_REL * bus.rate_hz:
        yield (
            f"it runs at {scan.bus_timing.bus_hz * 1e-3:.0f} kHz, {bus.rate_hz * 1e-3:.0f} kHz are configured",
            "dtparam=i2c_arm_baudrate and core_freq_min on a Raspberry Pi, or correct rate_hz",
        )
    skipped = [leg for leg in bus.channels if leg not in scan.legs]
    if scan.mux_answers and skipped:
        yield (
            f"{', '.join(skipped)} could not be scanned: the leg before them holds the bus, and nothing frees it",
            "that leg first; and wire the mux's RESET pin (mux.reset)",
        )
    yield from _surplus_chips(report, plan)


def _surplus_chips(report: ProbedBus, plan: AnyPlan) -> Iterator[tuple[str, str]]:
    """Yield observation and advice for chips of legs where no leg is configured."""
    bus, scan = report[:2]
    silent = ", ".join(leg for leg, chips in scan.legs.items() if chips.outcome is Reading.NO_ANSWER)
    lacks = "whether the configuration lacks a leg"
    for channel, chips in scan.channels.items():
        if isinstance(plan, ScanPlan):
            if not chips.legs and set(leg_chip_addresses(plan)) <= {*chips.answering}:
                yield (
                    f"a leg's chips answer on channel {channel}, which is no leg's",
                    f"whether they are those of {silent}" if silent else lacks,
                )
            continue
        own = {bus.converter_addresses[leg] for leg in chips.legs}
        behind = "" if bus.mux_address is None else f" on channel {channel}"
        for address in sorted({*chips.ad7147} - own):
            yield (
                f"an AD7147 answers at {address:#04x}{behind}, which is no leg's",
                f"whether it is that of {silent}: its straps ADD0, ADD1" if silent else lacks,
            )


def _missing_mux_fault(report: ProbedBus) -> tuple[str, str]:
    """Return observation and advice for a mux that does not answer."""
    bus, scan, drivers = report[:3]
    assert scan.upstream is not None
    address = bus.mux.address
    if address in drivers:
        return (
            f"the kernel's driver {drivers[address]} holds the mux at {address:#04x}",
            "unbind the driver, or name each of its channels as a bus with one leg; never both",
        )
    if address in scan.upstream.answering:
        return (
            f"the chip at {address:#04x} does not read back what is written, as a TCA9548A does",
            "which chip that is; LED and servo drivers have such addresses too",
        )
    others = ", ".join(f"{other:#04x}" for other in scan.upstream.answering if other in MUX_ADDRESSES)
    if others:
        return (
            f"no mux (TCA9548A) answers at {address:#04x}; {others} does",
            "its address straps A0..A2, or mux.address in the configuration",
        )
    return f"no mux (TCA9548A) answers at {address:#04x}", "its power, wires and RESET pin"


def leg_diagnoses(report: ProbedLeg) -> Iterator[Diagnosis]:
    """Yield the faults of a leg: of its chips, or if those work, of its foot.

    A leg that could not be scanned is a fault of its bus.
    """
    location = report.device if report.channel is None else f"channel {report.channel}"
    chips, scans = report.chips, report.scans
    chips_fail = chips is not None and chips.outcome is not Reading.OK
    if scans is not None and (scans.chips_fail_intermittently or chips_fail):
        n_lost = int(np.isin(scans.reading, CHIP_FAULT_READINGS).sum())
        observation = (
            f"{location}: its chips answer now and then; {n_lost} of {scans.reading.size} readings were lost"
        )
        yield Diagnosis(report.leg, observation, "its plug and cable: a loose contact")
    elif chips is not None and chips_fail:
        words = words_of_reading(chips.outcome)
        why = words.meaning if chips.outcome is Reading.BUS_STUCK else chips.why
        remedy = words.remedy
        if report.channel is None and report.address is not None and chips.outcome is Reading.NO_ANSWER:
            remedy += "; with the straps of another foot it falsifies that one's readings"
        yield Diagnosis(report.leg, f"{location}: {why}", remedy)
    if report.timing is not None and report.timing.wait_factor > 1.0:
        slower = f"{report.timing.wait_factor - 1:.0%}"
        observation = (
            f"{location}: its conversions take {slower} longer than the slowest converter may; "
            "all legs wait for them"
        )
        yield Diagnosis(report.leg, observation, "its supply; or replace the converter")
    for fault in report.faults:
        yield Diagnosis(report.leg, fault.observation, fault.advice)


#: Longest scan or search of one adapter [s]; they do some 1200 and 150 transactions.
SEARCH_LIMIT_S = 60.0
#: How often a transaction is repeated that fails, unless it asks an address where no chip has to be.
_N_REPEATS = 2


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
    if config.buses:  # a microcontroller has its own buses
        plan = config.scan_plan
        buses = tuple(_probe_buses(config, scene, plan))
        diagnoses += [diagnosis for report in buses for diagnosis in bus_diagnoses(report, plan)]
    feet, of_chips = None, None
    if all(report.scan.mux_answers for report in buses):
        for is_last in (False, True):  # a bus may fail now and then
            try:
                feet, of_chips = _scan_feet(config, scene)
                break
            except HardwareError as error:
                if is_last:
                    diagnoses.append(Diagnosis("scan", str(error), "this first: no foot was scanned"))
    if of_chips is not None:
        buses = tuple(_with_needed_reads(buses, [state.timing for state in of_chips], config.scan_plan))
    legs = tuple(_probed_legs(config, buses, feet, of_chips))
    diagnoses += [diagnosis for leg in legs for diagnosis in leg_diagnoses(leg)]
    return ProbeResult(buses, legs, tuple(diagnoses))


def _probe_buses(config: Config, scene: Scene | None, plan: AnyPlan) -> Iterator[ProbedBus]:
    """Yield the scan result of every bus."""
    robot = None if scene is None else simulated_robot(config, scene)
    with ExitStack() as stack:
        for bus, (legs, clock) in zip(config.buses, open_buses(config, robot, stack), strict=True):
            drivers = kernel_drivers(bus.device) if robot is None else {}
            yield probed_bus(bus, legs, clock, plan, drivers)


class _RepeatingBus:
    """Bus that repeats what fails: a probe is made where something fails now and then, and has to get to its end."""

    def __init__(self, bus: I2cBus, mux_address: int | None, chips: Collection[int]) -> None:
        self._bus = bus
        self._mux_address = mux_address
        self._expected = {mux_address, *chips}
        self.n_repeated = 0

    def transfer(self, transaction: Transaction) -> bytes:
        n_left, is_of_bus = _N_REPEATS, False
        while True:
            try:
                answer = self._bus.transfer(transaction)
            except I2cError as error:
                is_nobody = isinstance(error, NackError) and transaction.address not in self._expected
                if n_left == 0 or is_nobody:
                    raise
                n_left -= 1
                # An acknowledge that a leg loses is seen in its readings.
                is_of_bus |= isinstance(error, I2cTimeoutError) or transaction.address == self._mux_address
            else:
                self.n_repeated += is_of_bus
                return answer


def probed_bus(bus: Bus, legs: LegBus, clock: Clock, plan: AnyPlan, drivers: Mapping[int, str]) -> ProbedBus:
    """Return the chips found on a bus, also on one that fails now and then.

    Args:
        bus: Its configuration.
        legs: The way to its legs.
        clock: Its clock.
        plan: The scan to come.
        drivers: Kernel drivers by the address that each holds.
    """
    limited = TimeLimitedBus(legs.adapter, clock, bus.device, SEARCH_LIMIT_S)
    legs.adapter = repeating = _RepeatingBus(
        limited, bus.mux_address, (*leg_chip_addresses(plan), *bus.addresses.values())
    )
    try:
        scan = scan_bus(legs, clock, plan, bus.channels, bus.converter_addresses, drivers)
        failure = ""
    except HardwareError as error:
        scan, failure = BusScan(None, mux_answers=False, channels={}, bus_timing=None), str(error)
    return ProbedBus(bus, scan, drivers, repeating.n_repeated, failure)


def _with_needed_reads(
    buses: tuple[ProbedBus, ...], timings: list[ChipTiming | None], plan: AnyPlan
) -> Iterator[ProbedBus]:
    """Yield the buses with the limits of the registers that have to be read of their legs' converters."""
    of_legs = iter(timings)
    for report in buses:
        own = list(islice(of_legs, len(report.bus_config.channels)))
        timing = report.scan.bus_timing
        if timing is not None and any(each is not None and each.reads_whole_result for each in own):
            timing = timing.with_whole_results(plan, len(own))
        yield report._replace(scan=report.scan._replace(bus_timing=timing))


class _LegState(NamedTuple):
    """Timing of a leg's converter, and why it was last left out, in words."""

    timing: ChipTiming | None = None
    why: str = ""


def _scan_feet(config: Config, scene: Scene | None) -> tuple[list[FootScans], list[_LegState] | None]:
    """Return the readings of each foot over some scans, and the state of each leg; None with a microcontroller."""
    with open_scan_source(config, scene) as started:
        # Of converters that run freely, one bus may be read for that long while another waits for its first frame.
        free_scans = math.ceil(1e-6 * LONG_SILENCE_NS / config.shortest_scan_ms)
        n_discarded = free_scans if config.board == "ad7147" else SETTLING_SCANS
        frames = started.read_whole_scans(n_discarded + NOISE_SAMPLES)[n_discarded:]
        states = None
        if not isinstance(started.source, McuSource):
            legs = started.source.legs
            states = [_LegState(leg.timing if leg.is_timed else None, leg.why) for leg in legs]
    capacitance_pf = np.stack([frame.capacitance_pf for frame in frames], axis=1)
    reading = np.stack([frame.reading for frame in frames], axis=1)
    return [FootScans(*of_leg) for of_leg in zip(capacitance_pf, reading, strict=True)], states


def _probed_legs(
    config: Config,
    buses: tuple[ProbedBus, ...],
    feet: list[FootScans] | None,
    of_chips: list[_LegState] | None,
) -> Iterator[ProbedLeg]:
    """Yield the result of every leg, in the order of the configuration."""
    places: list[tuple[str, str, int | None, int | None, LegScan | None]] = []
    for report in buses:
        bus = report.bus_config
        for leg, channel in bus.channels.items():
            on_mux = None if bus.mux_address is None else channel
            address = bus.converter_addresses[leg] if config.board == "ad7147" else None
            places.append((leg, bus.device, on_mux, address, report.scan.legs.get(leg)))
    if config.serial is not None:
        places = [(name, config.serial.device, None, None, None) for name in config.legs]
    # By the configuration and the design alone, without the calibrations.
    known = mounted_feet(replace(load_models(config), calibrations_by_leg={}))
    for row, place in enumerate(places):
        scans = None if feet is None or IS_SILENT[feet[row].reading].all() else feet[row]
        state = of_chips[row] if of_chips else _LegState()
        faults: tuple[FootFault, ...] = ()
        if (
            scans is not None and not scans.chips_fail_intermittently
        ):  # readings lost by a loose contact say nothing of the foot
            faults = foot_faults(
                scans,
                known.stray_pf[row],
                known.unloaded_pf[row],
                config.tare,
                has_shared_lines=config.board != "ad7147",
                why_left_out=state.why,
            )
        yield ProbedLeg(*place, state.timing, scans, faults)
