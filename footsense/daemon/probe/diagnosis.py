"""Diagnosis of bus and leg faults as text: location, observation, advice."""

from collections.abc import Iterator

import numpy as np

from footsense.acquisition.probe.bus_scan import leg_chip_addresses
from footsense.acquisition.probe.foot_check import CHIP_FAULT_READINGS
from footsense.acquisition.scan_plan import ScanPlan
from footsense.daemon.acquisition import MIN_BUS_SPEED_REL
from footsense.daemon.probe.report import Diagnosis, ProbedBus, ProbedLeg
from footsense.frames import Reading
from footsense.leg_words import words_of_reading

_MUX_ADDRESSES = range(0x70, 0x78)


def bus_diagnoses(report: ProbedBus, plan: ScanPlan) -> Iterator[Diagnosis]:
    """Yield the faults that concern a whole bus."""
    for observation, advice in _bus_faults(report, plan):
        yield Diagnosis(report.bus_config.device, observation, advice)


def _bus_faults(report: ProbedBus, plan: ScanPlan) -> Iterator[tuple[str, str]]:
    """Yield observation and advice for each fault of a bus."""
    bus, scan, drivers = report
    if scan.upstream is None:
        needs_wire = not bus.mux.reset
        wire = "; only the mux's RESET pin frees a leg that holds it: wire one" if needs_wire else ""
        yield (
            "SDA or SCL is held low on the upstream bus, and the mux cannot free it",
            f"short, missing pull-ups or an unpowered chip upstream of the mux{wire}",
        )
        return
    for address in leg_chip_addresses(plan):
        if bus.leg is None and address in (*scan.upstream.answering, *drivers):
            yield (
                f"something answers at {address:#04x} with no leg connected: a chip of every leg has that address",
                "what it is; move it to another address or another bus",
            )
    if not scan.mux_answers:
        yield _missing_mux_fault(report)
    if scan.bus_timing is not None and scan.bus_timing.costs.bus_hz < MIN_BUS_SPEED_REL * bus.rate_hz:
        yield (
            f"it runs at {scan.bus_timing.costs.bus_hz * 1e-3:.0f} kHz, {bus.rate_hz * 1e-3:.0f} kHz are configured",
            "dtparam=i2c_arm_baudrate and core_freq_min on a Raspberry Pi, or correct rate_hz",
        )
    skipped = [leg for leg, channel in bus.channels.items() if channel not in scan.channels]
    if scan.mux_answers and skipped:
        yield (
            f"{', '.join(skipped)} could not be scanned: the leg before them holds the bus, and nothing frees it",
            "that leg first; and wire the mux's RESET pin (mux.reset)",
        )
    silent = {channel for channel, chips in scan.channels.items() if chips.outcome is Reading.NO_ANSWER}
    missing = ", ".join(leg for leg, channel in bus.channels.items() if channel in silent)
    for channel, chips in scan.channels.items():
        is_no_leg = channel not in bus.channels.values()
        if is_no_leg and set(leg_chip_addresses(plan)) <= {*chips.answering}:
            yield (
                f"a leg's chips answer on channel {channel}, which is no leg's",
                f"whether they are those of {missing}"
                if missing
                else "whether the configuration lacks a leg",
            )


def _missing_mux_fault(report: ProbedBus) -> tuple[str, str]:
    """Return observation and advice for a mux that does not answer."""
    bus, scan, drivers = report
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
    others = ", ".join(f"{other:#04x}" for other in scan.upstream.answering if other in _MUX_ADDRESSES)
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
    elif chips is not None and chips.outcome is Reading.BUS_STUCK:
        words = words_of_reading(chips.outcome)
        yield Diagnosis(report.leg, f"{location}: {words.meaning}", words.remedy)
    elif chips is not None and chips_fail:
        yield Diagnosis(report.leg, f"{location}: {chips.why}", words_of_reading(chips.outcome).remedy)
    if report.timing is not None and report.timing.wait_factor > 1.0:
        slower = f"{100 * (report.timing.wait_factor - 1):.0f} %"
        observation = (
            f"{location}: its conversions take {slower} longer than the slowest converter may; "
            "all legs wait for them"
        )
        yield Diagnosis(report.leg, observation, "its supply; or replace the converter")
    for fault in report.faults:
        yield Diagnosis(report.leg, fault.observation, fault.advice)
