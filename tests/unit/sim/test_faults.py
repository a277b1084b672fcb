"""What breaks in the simulation does what a bus, a chip or a foot would show, from its beginning to its end."""

from pathlib import Path

import numpy as np
import pytest

from footsense.errors import ConfigError, I2cError, NackError
from footsense.ports import Transaction
from footsense.sim.chips.chip import FLOATING_ROW_PF, LineStates, SimulatedLineSwitch, SimulatedMux
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.clock import VirtualClock
from footsense.sim.faults import scene_faults
from footsense.sim.faults.chip_faults import inject_chip_faults
from footsense.sim.faults.damage import OPEN_ELEMENT_PF, SHORTED_ELEMENT_PF, pin_capacitance_pf
from footsense.sim.faults.scene_faults import ChipFault, WireFault
from footsense.sim.faults.wire_faults import WireFaults
from footsense.sim.i2c_bus import SimulatedBus
from footsense.sim.rubber import DRIFT_PF_PER_K, WarmingFoot
from footsense.sim.scene import Warming, load_scene

MUX, SWITCH, CONVERTER = 0x71, 0x49, 0x50
TIMEOUT_NS = 20_000_000
S_NS = 1_000_000_000

ASK_SWITCH = Transaction(SWITCH, b"", 1)
COLUMN_PF = (5.0, 6.0, 7.0)
#: Row 0 at ground, the others at the shield.
ROW_0 = LineStates(0, selected_mask=0b001, unselected_mask=0b110)


class Bench:
    """Two legs on channels 0 and 1 of a bus on which something breaks."""

    def __init__(self, *on_wires: WireFault, on_leg_0: tuple[ChipFault, ...] = ()) -> None:
        self.clock = VirtualClock()
        self.mux = SimulatedMux(MUX)
        rng = np.random.default_rng(1)
        legs = {
            leg: inject_chip_faults(
                SimulatedFdc1004(lambda cin, t_start, t_end: 5.0, None),
                SimulatedLineSwitch(),
                list(on_leg_0) if leg == 0 else [],
                rng,
            )
            for leg in (0, 1)
        }
        faults = WireFaults(on_wires, {"lf": 0, "lm": 1}, TIMEOUT_NS, rng)
        self.bus = SimulatedBus(self.clock, 400_000, 0, self.mux, legs, faults)

    def at(self, t_s: float) -> "Bench":
        self.clock.sleep_until_ns(round(t_s * S_NS))
        return self

    def select(self, control: int) -> None:
        self.bus.transfer(Transaction(MUX, bytes((control,))))

    def word(self, pointer: int) -> int:
        return int.from_bytes(self.bus.transfer(Transaction(CONVERTER, bytes((pointer,)), 2)), "big")


def test_a_lost_arbitration_is_tried_again_three_times() -> None:
    """Always losing is an error that says so; losing half of the time fails a sixteenth."""
    with pytest.raises(I2cError, match="arbitration lost"):
        Bench(scene_faults.ArbitrationLost(at_s=0.0, rate_rel=1.0)).select(0)
    bench = Bench(scene_faults.ArbitrationLost(at_s=0.0, rate_rel=0.5))
    failed = 0
    for _ in range(1000):
        try:
            bench.select(0)
        except I2cError:
            failed += 1
    assert 40 < failed < 90


def test_a_mux_forgets_its_channels_once() -> None:
    """Until it is told again."""
    bench = Bench(scene_faults.MuxReset(at_s=1.0))
    bench.select(0b11)
    assert bench.bus.transfer(ASK_SWITCH) == b"\x00"
    with pytest.raises(NackError):
        bench.at(1.0).bus.transfer(ASK_SWITCH)
    bench.select(0b11)
    assert bench.bus.transfer(ASK_SWITCH) == b"\x00"


@pytest.mark.parametrize("rate_rel", [0.1, 1.0])
def test_what_happens_at_random_happens_as_often_as_is_said(rate_rel: float) -> None:
    """Acknowledges that are lost, and single bits that are wrong; the other leg has none of it."""
    loose = Bench(on_leg_0=(scene_faults.NackAtRandom(at_s=0.0, leg="lf", rate_rel=rate_rel),))
    noisy = Bench(on_leg_0=(scene_faults.CorruptReads(at_s=0.0, leg="lf", rate_rel=rate_rel),))
    lost = wrong = 0
    for bench in (loose, noisy):
        bench.select(0b01)
    for _ in range(1000):
        try:
            loose.word(0xFE)
        except NackError:
            lost += 1
        flipped = noisy.word(0xFE) ^ 0x5449
        assert flipped.bit_count() <= 1
        wrong += flipped != 0
    for bench in (loose, noisy):
        bench.select(0b10)
        assert bench.word(0xFE) == 0x5449
    assert abs(lost - 1000 * rate_rel) < 40
    assert abs(wrong - 1000 * rate_rel) < 40


@pytest.mark.parametrize(
    ("states", "broken", "shorted", "expected_pf"),
    [
        (ROW_0, 0b000, 0b000, 5.0),
        (ROW_0, 0b001, 0b000, 5.0 * FLOATING_ROW_PF / (5.0 + FLOATING_ROW_PF)),
        (ROW_0, 0b010, 0b000, 5.0 + 6.0 * FLOATING_ROW_PF / (6.0 + FLOATING_ROW_PF)),
        (ROW_0, 0b000, 0b001, SHORTED_ELEMENT_PF),
        (ROW_0, 0b000, 0b010, 0.0),
        (ROW_0, 0b010, 0b010, 5.0 + FLOATING_ROW_PF),
        (LineStates(0, 0b111, 0), 0b000, 0b000, 18.0),
    ],
)
def test_a_pin_sees_its_column_through_its_row_lines(
    states: LineStates, broken: int, shorted: int, expected_pf: float
) -> None:
    """A grounded row counts, a shielded one does not, a floating one in series with itself; a short overrides all."""
    assert pin_capacitance_pf(COLUMN_PF, states, broken, shorted) == pytest.approx(expected_pf)
    assert 0.5 * min(COLUMN_PF) > OPEN_ELEMENT_PF


def test_warmth_takes_every_zero_along_a_little_differently_and_stiffens_the_foot() -> None:
    """20 K are some 30 fF on each element, and 9 % of stiffness; nothing before and no more after."""
    foot = WarmingFoot(Warming(from_s=1.0, over_s=10.0, kelvin=20.0), np.random.default_rng(1))
    assert not any(foot.drift_pf(1 * S_NS))
    assert foot.relative_compliance(1 * S_NS) == 1.0
    half_pf, drift_pf = np.array([foot.drift_pf(6 * S_NS), foot.drift_pf(11 * S_NS)])
    np.testing.assert_allclose(half_pf, drift_pf / 2)
    assert drift_pf.mean() == pytest.approx(20 * DRIFT_PF_PER_K, rel=0.2)
    assert 0.05 < abs(drift_pf.std() / drift_pf.mean()) < 0.4
    assert foot.relative_compliance(99 * S_NS) == pytest.approx(1 / 1.088)


def test_every_fault_has_a_name_in_a_scene(tmp_path: Path) -> None:
    """That of its class in lower case; what ends before it begins is refused with its place."""
    scene = tmp_path / "scene.yaml"
    start = "description: all\nload: {kind: unloaded}\nfaults:\n"
    scene.write_text(
        start + "  - {at_s: 3.2, leg: rm, fault: stuck_sda}\n"
        "  - {at_s: 1, until_s: 2, leg: lf, fault: element_drifts, element: 3, rate_ff_per_s: 20}\n"
        "  - {at_s: 1, bus: 0, fault: arbitration_lost, rate_rel: 0.1}\n"
        "  - {at_s: 1, until_s: 2, fault: can_bus_off}\n"
    )
    names = [type(fault).__name__ for fault in load_scene(str(scene)).faults]
    assert names == ["StuckSda", "ElementDrifts", "ArbitrationLost", "CanBusOff"]
    scene.write_text(start + "  - {at_s: 2, until_s: 2, leg: lf, fault: absent}\n")
    with pytest.raises(ConfigError, match=r"faults\[0\].until_s: must be later than at_s"):
        load_scene(str(scene))


def test_a_mux_that_keeps_its_channels_acknowledges_others() -> None:
    """From its beginning to its end; it reads back what it connects."""
    bench = Bench()
    bench.mux.keeps_channels_ns = [(1.0 * S_NS, 2.0 * S_NS)]
    bench.select(0b01)
    bench.at(1.0).select(0b10)
    assert bench.bus.transfer(Transaction(MUX, b"", 1)) == b"\x01"
    bench.at(2.0).select(0b10)
    assert bench.bus.transfer(Transaction(MUX, b"", 1)) == b"\x02"
