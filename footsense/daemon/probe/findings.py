"""What is wrong on a robot's buses, in words: where, what was found instead of what, and what to check."""

from collections.abc import Iterator

import numpy as np

from footsense.acquisition.probe.bus_scan import leg_addresses
from footsense.acquisition.probe.foot_check import CHIP_READINGS
from footsense.acquisition.scan_plan import ScanPlan
from footsense.daemon.probe.report import BusReport, Complaint, LegReport
from footsense.frames import Reading

__all__ = ["SLOW_REL", "bus_complaints", "leg_complaints"]

#: Share of the configured clock below which a bus is slow.
SLOW_REL = 0.9
_MUXES = range(0x70, 0x78)


def bus_complaints(report: BusReport, plan: ScanPlan) -> Iterator[Complaint]:
    """Tell what is wrong with a bus as a whole.

    Yields:
        One complaint after the other.
    """
    bus, seen, claimed = report
    if seen.trunk is None:
        yield Complaint(
            bus.device,
            "SDA or SCL is held low on the trunk, and the mux cannot free it",
            "short, missing pull-ups or an unpowered chip on the trunk"
            + (
                ""
                if bus.mux.reset
                else "; a leg that holds it is only freed by the mux's RESET pin: wire one"
            ),
        )
        return
    for address in leg_addresses(plan):
        if not bus.adapters and address in (*seen.trunk.answering, *claimed):
            name = next((d.name for d in bus.other_devices if d.address == address), "something")
            yield Complaint(
                bus.device,
                f"{name} answers at {address:#04x} with no leg connected: a chip of every leg has that address",
                "what it is; move it to another address or another bus",
            )
    if not seen.mux_answers:
        yield Complaint(bus.device, *_no_mux(report))
    if seen.timing is not None and seen.timing.costs.rate_hz < SLOW_REL * bus.rate_hz:
        yield Complaint(
            bus.device,
            f"it runs at {seen.timing.costs.rate_hz * 1e-3:.0f} kHz, {bus.rate_hz * 1e-3:.0f} kHz are configured",
            "dtparam=i2c_arm_baudrate and core_freq_min on a Raspberry Pi, or correct rate_hz",
        )
    unseen = [leg for leg, channel in bus.channels.items() if channel not in seen.places]
    if seen.mux_answers and unseen:
        yield Complaint(
            bus.device,
            f"{', '.join(unseen)} could not be looked at: the leg before them holds the bus, and nothing frees it",
            "that leg first; and wire the mux's RESET pin (mux.reset)",
        )
    lacking = {
        leg
        for leg, channel in bus.channels.items()
        if channel in seen.places and seen.places[channel].outcome is Reading.NO_ANSWER
    }
    for channel, place in seen.places.items():
        of_no_leg = not bus.adapters and channel not in bus.channels.values()
        if of_no_leg and set(leg_addresses(plan)) <= {*place.answering}:
            yield Complaint(
                bus.device,
                f"a leg's chips answer on channel {channel}, which is no leg's",
                f"whether they are those of {', '.join(lacking)}"
                if lacking
                else "whether the configuration lacks a leg",
            )


def _no_mux(report: BusReport) -> tuple[str, str]:
    """Return what is wrong with a mux, and what to check."""
    bus, seen, claimed = report
    assert seen.trunk is not None
    address = bus.mux.address
    if address in claimed:
        return (
            f"the kernel's driver {claimed[address]} holds the mux at {address:#04x}",
            "name each leg's adapter instead of its channel, or unbind the driver; never both",
        )
    if address in seen.trunk.answering:
        return (
            f"what answers at {address:#04x} does not hold what it is told, as a TCA9548A does",
            "which chip that is; LED and servo drivers have such addresses too",
        )
    others = [other for other in seen.trunk.answering if other in _MUXES]
    found = f"; {', '.join(f'{other:#04x}' for other in others)} does" if others else ""
    return (
        f"no mux (TCA9548A) answers at {address:#04x}{found}",
        "its address straps A0..A2, or mux.address in the configuration"
        if others
        else "its power, wires and RESET pin",
    )


def leg_complaints(report: LegReport) -> Iterator[Complaint]:
    """Tell what is wrong with a leg: its chips, or if they are well, its foot.

    Of a leg that could not be looked at, its bus tells.

    Yields:
        One complaint after the other.
    """
    where = f"channel {report.where}" if isinstance(report.where, int) else f"adapter {report.where}"
    place, scans = report.place, report.scans
    if scans is not None and (
        scans.is_intermittent or (place is not None and place.outcome is not Reading.OK)
    ):
        n_lost = int(np.isin(scans.reading, CHIP_READINGS).sum())
        what = f"{where}: its chips answer now and then; {n_lost} of {scans.reading.size} readings were lost"
        yield Complaint(report.leg, what, "its plug and cable: a loose contact")
    elif place is not None and place.outcome is Reading.BUS_STUCK:
        what = f"it holds SDA or SCL low as soon as {where} is connected"
        yield Complaint(report.leg, what, "short in its cable or plug, and whether its chips have power")
    elif place is not None and place.outcome is not Reading.OK:
        yield Complaint(report.leg, f"{where}: {place.why}", _CHECKS[place.outcome])
    for found in report.found:
        yield Complaint(report.leg, found.what, found.check)


_CHECKS = {
    Reading.NO_ANSWER: "its plug, its 3.3 V, and whether this is its channel",
    Reading.WRONG_CHIP: "what is plugged in there, and `board` in the configuration",
    Reading.DELAYED: "other masters on this bus, its pull-ups and its clock",
}
