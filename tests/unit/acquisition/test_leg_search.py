"""Legs that hold the bus, come and go: found, left out and taken in again, and the others never read a wrong number."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footsense.acquisition.free_scanner import FreeScanner
from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.scan_plan import AD7147_PLAN, scan_plan
from footsense.acquisition.scanner import BusScanner
from footsense.frames import CapFrame, Reading
from footsense.sim.chips.ad7147 import SimulatedAd7147
from footsense.sim.chips.chip import SimulatedLineSwitch, SimulatedMux
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.clock import VirtualClock
from footsense.sim.faults import scene_faults
from footsense.sim.faults.chip_faults import inject_chip_faults
from footsense.sim.faults.damage import pin_capacitance_pf
from footsense.sim.faults.scene_faults import ChipFault, Leg, WireFault
from footsense.sim.faults.wire_faults import WireFaults
from footsense.sim.i2c_bus import SimulatedBus

LEGS = {"lf": 0, "lm": 1, "lr": 2}
#: A different capacitance for every element, so that a swap shows [pF].
DISTINCT_PF = 5.0 + 0.125 * np.arange(9)
TIMEOUT_NS = 20_000_000
WORKS_AGAIN_S = 1.0


def column_pf(switch: SimulatedLineSwitch, cin: int, t_start_ns: int, t_end_ns: int) -> float:
    """Return what a pin sees of its column."""
    return sum(
        share * pin_capacitance_pf(DISTINCT_PF[cin::3].tolist(), states)
        for share, states in switch.states_between(t_start_ns, t_end_ns)
    )


class Robot:
    """Three legs on a bus on which something breaks, and their scanner, started."""

    def __init__(
        self, script: list[ChipFault | WireFault], *, reset: bool = True, compares: bool = True
    ) -> None:
        self.clock = VirtualClock()
        rng = np.random.default_rng(1)
        mux = SimulatedMux(0x71)
        chips = {}
        for leg, channel in LEGS.items():
            switch = SimulatedLineSwitch()
            converter = SimulatedFdc1004(partial(column_pf, switch), None)
            own = [f for f in script if isinstance(f, ChipFault) and f.leg == leg]
            chips[channel] = inject_chip_faults(converter, switch, own, rng)
        faults = WireFaults(
            [f for f in script if isinstance(f, WireFault)], LEGS, TIMEOUT_NS, rng, adapter_compares=compares
        )
        bus = SimulatedBus(self.clock, 400_000, 0, mux, chips, faults)
        plan = scan_plan(400)
        self.scanner = BusScanner(LegBus(bus, 0x71, mux if reset else None), self.clock, LEGS, plan)
        self.scanner.start()

    def scan(self) -> CapFrame:
        """Read to the end of a scan, where settings are checked; a conversion that was lost twice is read again."""
        readings = self.scanner.read()
        while self.scanner._position:
            readings = self.scanner.read()
        return readings

    def scan_until(self, t_s: float) -> list[CapFrame]:
        scans = []
        while self.clock.now_ns() < t_s * 1e9:
            scans.append(self.scan())
        return scans


def test_every_outage_costs_a_leg_the_same() -> None:
    """0.3 s away and back within half a second, the third time as the first: the pauses begin anew each time."""
    outages_s = (0.5, 3.0, 5.5, 8.0)
    robot = Robot([scene_faults.Absent(at_s=at_s, until_s=at_s + 0.3, leg="lm") for at_s in outages_s])
    for at_s in outages_s:
        robot.scan_until(at_s + 0.25)
        assert (robot.scan().reading[1] == Reading.NO_ANSWER).all()
        robot.scan_until(at_s + 0.8)
        assert (robot.scan().reading == Reading.OK).all()


def test_a_leg_is_left_out_after_three_bad_scans_in_a_row_and_not_after_three() -> None:
    """A wire that fails once a second costs single scans, never a pause."""
    robot = Robot(
        [scene_faults.Absent(at_s=at_s, until_s=at_s + 0.01, leg="lm") for at_s in np.arange(1.0, 6.0)]
    )
    bad = [scan.reading[1] != Reading.OK for scan in robot.scan_until(6.5)]
    assert 5 <= np.any(bad, axis=1).sum() <= 10


def test_a_mux_that_forgets_its_selection_costs_no_reading() -> None:
    """Whenever in a scan it happens: what fails is connected anew before it is tried again."""
    for n in range(40):
        robot = Robot([scene_faults.MuxReset(at_s=0.5 + n * 0.6e-3)])
        assert all((scan.reading == Reading.OK).all() for scan in robot.scan_until(0.6))


@pytest.mark.parametrize(("at_s", "held"), [(0.5, ["lf", "lr"]), (0.0, ["lf"])])
def test_legs_that_hold_the_bus_are_all_left_out(at_s: float, held: list[Leg]) -> None:
    """Two are found one after the other; at the start the service begins without them."""
    robot = Robot([scene_faults.StuckSda(at_s=at_s, until_s=1.0, leg=leg) for leg in held])
    robot.scan_until(0.6)
    outcome = [Reading.BUS_STUCK if leg in held else Reading.OK for leg in LEGS]
    assert (robot.scan().reading == np.array(outcome)[:, None]).all()
    assert (robot.scan_until(3.0)[-1].reading == Reading.OK).all()


def test_a_leg_that_holds_the_bus_while_its_converter_is_timed_is_left_out() -> None:
    """At the first start too; the others begin without it."""
    fault = scene_faults.StuckSda(at_s=0.0117, until_s=0.5, leg="lf")
    robot = Robot([scene_faults.StuckConverter(at_s=0.0, until_s=0.25, leg="lf"), fault])
    robot.scan_until(0.4)
    assert (robot.scan().reading[:, 0] == [Reading.BUS_STUCK, Reading.OK, Reading.OK]).all()
    assert (robot.scan_until(9.0)[-1].reading == Reading.OK).all()


def test_an_adapter_that_acknowledges_for_a_held_line_is_seen_through() -> None:
    """As on a Raspberry Pi 0 to 4: every address answers, with zeros, also one that no chip has."""
    robot = Robot([scene_faults.StuckSda(at_s=0.5, leg="lm")], compares=False)
    scans = robot.scan_until(3.0)
    for scan in scans:
        ok = scan.reading == Reading.OK
        np.testing.assert_array_equal(scan.capacitance_pf[ok], np.tile(DISTINCT_PF, (3, 1))[ok])
    assert (robot.scan().reading[:, 0] == [Reading.OK, Reading.BUS_STUCK, Reading.OK]).all()
    lost_ns = [scan.t_ns.max() for scan in scans if (scan.reading[[0, 2]] == Reading.OK).all()]
    assert max(np.diff(lost_ns)) < 0.8e9


@pytest.mark.parametrize("reset", [False, True])
def test_a_chip_that_was_interrupted_within_a_byte_is_clocked_out(*, reset: bool) -> None:
    """Nine clocks with SDA released let it finish the byte, with or without a RESET pin; all legs come back."""
    fault = scene_faults.StuckSda(at_s=0.5, leg="lm", within_byte=True)
    robot = Robot([fault], reset=reset, compares=False)
    scans = robot.scan_until(2.5)
    assert any((scan.reading != Reading.OK).any() for scan in scans)
    assert (scans[-1].reading == Reading.OK).all()


LEG_NAMES: st.SearchStrategy[Leg] = st.sampled_from(["lf", "lm", "lr"])
SPANS = st.tuples(st.floats(0.0, 0.6), st.floats(0.01, 0.3))


@st.composite
def scripts(draw: st.DrawFn) -> list[ChipFault | WireFault]:
    """Return faults of any kind but those that falsify what is read, all over after `WORKS_AGAIN_S`.

    Acknowledges that are lost at random are not among them: a leg that misses the broadcast of its row and then the
    broadcast question about it converts the wrong row unseen, at the square of that rate.
    """
    kinds = st.sampled_from(["absent", "converter", "switch", "brown_out", "sda", "trunk", "mux", "lost"])
    script: list[ChipFault | WireFault] = []
    for kind in draw(st.lists(kinds, max_size=5)):
        at_s, lasts_s = draw(SPANS)
        leg, until_s = draw(LEG_NAMES), at_s + lasts_s
        match kind:
            case "absent":
                script.append(scene_faults.Absent(at_s=at_s, until_s=until_s, leg=leg))
            case "converter":
                script.append(scene_faults.StuckConverter(at_s=at_s, until_s=until_s, leg=leg))
            case "switch":
                script.append(scene_faults.SwitchIgnoresWrites(at_s=at_s, until_s=until_s, leg=leg))
            case "brown_out":
                script.append(scene_faults.BrownOut(at_s=at_s, leg=leg))
            case "sda":
                script.append(scene_faults.StuckSda(at_s=at_s, until_s=until_s, leg=leg))
            case "trunk":
                script.append(scene_faults.StuckUpstreamBus(at_s=max(at_s, 0.05), until_s=max(until_s, 0.06)))
            case "mux":
                script.append(scene_faults.MuxReset(at_s=at_s))
            case _:
                script.append(
                    scene_faults.ArbitrationLost(
                        at_s=max(at_s, 0.05), until_s=max(until_s, 0.06), rate_rel=0.3
                    )
                )
    return script


@given(scripts())
@settings(max_examples=20)
def test_whatever_breaks_a_reading_is_right_or_missing_and_all_come_back(
    script: list[ChipFault | WireFault],
) -> None:
    """No exception, no wrong number, no stamp older than its scan; all is well some seconds after the last."""
    robot = Robot(script)
    while robot.clock.now_ns() < WORKS_AGAIN_S * 1e9:
        scan = robot.scan()
        ok = scan.reading == Reading.OK
        np.testing.assert_array_equal(scan.capacitance_pf[ok], np.tile(DISTINCT_PF, (3, 1))[ok])
        assert np.isnan(scan.capacitance_pf[~ok]).all()
        # A scan, and two timeouts of each leg.
        assert (robot.clock.now_ns() - scan.t_ns[ok] < 25_000_000 + 6 * TIMEOUT_NS).all()
    scan = robot.scan()
    while (scan.reading != Reading.OK).any():
        assert robot.clock.now_ns() < (WORKS_AGAIN_S + 20.0) * 1e9
        scan = robot.scan()


def test_legs_that_are_found_together_begin_with_a_whole_conversion() -> None:
    """The search of all legs outlasts a wait for none; what follows is never two readings at one time."""
    robot = Robot([scene_faults.StuckUpstreamBus(at_s=0.1, until_s=0.3)])
    looks_ns = []
    while robot.clock.now_ns() < 1_500_000_000:
        robot.scanner.read()
        looks_ns.append(robot.clock.now_ns())
    assert min(np.diff(looks_ns)) > 2_000_000


@pytest.mark.parametrize(("gain_rel", "reads_pf"), [(-0.35, "3.1"), (0.35, "6.3")])
def test_a_leg_whose_reference_is_off_is_left_out_with_a_line(
    caplog: pytest.LogCaptureFixture, gain_rel: float, reads_pf: str
) -> None:
    """It says what the capacitor reads and what to check; the leg beside it on the same wires is read."""
    clock, addresses = VirtualClock(), {"lf": 0x2C, "lm": 0x2D}
    chips = [
        SimulatedAd7147(lambda cin, *_: 4.7 if cin == 12 else 5.4, None, address=address, gain_rel=gain)
        for address, gain in zip(addresses.values(), (0.0, gain_rel), strict=True)
    ]
    bus = LegBus(SimulatedBus(clock, 400_000, 0, None, {0: chips}), None)
    scanner = FreeScanner(bus, clock, dict.fromkeys(addresses, 0), addresses, AD7147_PLAN)
    scanner.start()
    readings = [scanner.read() for _ in range(4)][-1].reading
    assert (readings[0] == Reading.OK).all()
    assert (readings[1] == Reading.MISCONFIGURED).all()
    (line,) = caplog.messages
    assert line.startswith(f"leg lm: its reference capacitor reads {reads_pf} pF, and has 4.7 pF; ")
    assert ": check the capacitor at CIN12 and its joints; left out of the scan" in line
