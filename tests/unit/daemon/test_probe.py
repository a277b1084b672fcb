"""What a probe says of robots on which something is wrong: where, what, and what to check."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import pytest
from rich.console import Console

from footsense.acquisition.bus_scan import AddressProbe, scan_bus
from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.mcu_source import Serial
from footsense.acquisition.scan_plan import AD7147_PLAN, scan_plan
from footsense.cli.setup.probe import element_marks, probe_json, probe_picture
from footsense.cli.setup.robot_file import unloaded_yaml
from footsense.config import SMALL_BOARD, Config
from footsense.config.sections import Bus, Mux
from footsense.daemon.setup.probe import ProbedBus, ProbeResult, bus_diagnoses, probe, probed_bus
from footsense.errors import I2cError, I2cTimeoutError, NackError
from footsense.frames import Reading
from footsense.ports import I2cBus, Transaction
from footsense.sim.chips.ad7147 import SimulatedAd7147
from footsense.sim.chips.chip import SimulatedChip, SimulatedLineSwitch, SimulatedMux
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.clock import VirtualClock
from footsense.sim.faults import scene_faults
from footsense.sim.faults.scene_faults import Fault
from footsense.sim.i2c_bus import SimulatedBus
from footsense.sim.scene import Ad7147Effects, Effects, load_scene
from footsense.sim.scene_loads import Constant
from tests.contract.boards import Saboteur
from tests.support.feet import DESIGN

HANGING = load_scene("hanging")
CHANNELS = {"lf": 0, "lm": 1}


def probed(*broken: Fault, config: Config = SMALL_BOARD) -> ProbeResult:
    return probe(config, msgspec.structs.replace(HANGING, faults=broken))


def shown(found: ProbeResult) -> str:
    console = Console(width=80, file=io.StringIO(), record=True)
    console.print(probe_picture(found, "test"))
    return console.export_text()


def test_the_clock_of_each_converter_and_what_it_keeps_is_told() -> None:
    """A slow one is a fault, for all wait for it; one that forgets is none, and named with what follows."""
    sound = probed()
    assert "400000" in shown(sound)
    assert {leg["slowness_rel"] for leg in probe_json(sound)["legs"].values()} == {1.0}
    found = probe(
        SMALL_BOARD, msgspec.structs.replace(HANGING, seed=2, effects=Effects(converter_clock_rel=0.1))
    )
    slow = [leg.leg for leg in found.legs if leg.timing and leg.timing.wait_factor > 1.0]
    assert 0 < len(slow) < 6
    assert [diagnosis.location for diagnosis in found.diagnoses] == slow
    assert all(
        "longer than the slowest converter may" in diagnosis.observation for diagnosis in found.diagnoses
    )
    found = probe(SMALL_BOARD, msgspec.structs.replace(HANGING, effects=Effects(trigger_clears_done=True)))
    assert found.diagnoses == ()
    assert {leg["keeps_done"] for leg in probe_json(found)["legs"].values()} == {False}
    assert shown(found).count("upper, first") == 6
    both = Effects(done_needs_both_reads=True)
    found = probe(SMALL_BOARD, msgspec.structs.replace(HANGING, effects=both, host_cost_us=100.0))
    assert found.diagnoses == ()
    assert probe_json(found)["scan_ms"] == pytest.approx(38, abs=1)
    assert {leg["done_needs_both_reads"] for leg in probe_json(found)["legs"].values()} == {True}
    assert shown(found).count("both") == 6


def test_nothing_is_wrong_with_a_sound_robot() -> None:
    """Its readings are ready to be pasted, its limits are those of the bus, and the picture fits a terminal."""
    found = probed()
    assert found.diagnoses == ()
    assert unloaded_yaml(found).splitlines()[0] == "unloaded_pf:"
    assert all(leg.unloaded_pf == pytest.approx([DESIGN.unloaded_pf] * 9, abs=2e-3) for leg in found.legs)
    figures = probe_json(found)
    assert figures["buses"][0]["rate_hz"] == pytest.approx(400_000, rel=1e-3)
    assert figures["scan_ms"] == pytest.approx(1.065 * 22.5, abs=0.02)
    assert 0.6 < figures["legs"]["rm"]["noise_ff"][4] < 1.4  # 0.916, of 20 scans
    text = shown(found)
    assert max(map(len, text.splitlines())) <= 80
    assert text.count("sound") == text.count("upper") == 6


@pytest.mark.parametrize(
    ("broken", "what", "check"),
    [
        (scene_faults.Absent(at_s=0, leg="lm"), "channel 1: no answer at 0x50", "its plug"),
        (scene_faults.WrongChip(at_s=0, leg="lm"), "an FDC1004 says 54 49 10 04", "what is plugged in"),
        (scene_faults.BrokenRow(at_s=0, leg="lm", row=1), "row 1 is interrupted", "the row switch"),
        (
            scene_faults.BrokenColumn(at_s=0, leg="lm", column=2),
            "column 2 is interrupted",
            "the converter's pin",
        ),
        (scene_faults.ElementOpen(at_s=0, leg="lm", element=5), "element 5 is open", "row 1, column 2"),
        (
            scene_faults.ElementShorted(at_s=0, leg="lm", element=4),
            "element 4 is shorted",
            "row 1, column 1 touch",
        ),
        (scene_faults.GapClosed(at_s=0, leg="lm", element=4), "its gap is closed", "water"),
        (scene_faults.StuckSda(at_s=0, leg="lm"), "low as soon as it is connected", "short"),
        (scene_faults.StuckConverter(at_s=0, leg="lm"), "does not finish", "supply"),
        (scene_faults.SwitchIgnoresWrites(at_s=0, leg="lm"), "does not hold its settings", "RESET"),
        (scene_faults.NackAtRandom(at_s=0, leg="lm", rate_rel=0.01), "now and then", "loose contact"),
    ],
)
def test_a_fault_on_one_leg_is_one_line_on_that_leg(broken: Fault, what: str, check: str) -> None:
    """It names the leg, and what to look at; the other legs are sound and give what to configure."""
    found = probed(broken)
    (diagnosis,) = found.diagnoses
    assert diagnosis.location == "lm"
    assert what in diagnosis.observation
    assert check in diagnosis.advice
    assert [leg.leg for leg in found.legs if leg.unloaded_pf is None] == ["lm"]
    assert probe_json(found)["scan_ms"] is not None


def test_feet_of_a_microcontroller_are_judged_alike() -> None:
    """By what they read; its buses are its own, and nothing is said of them."""
    config = msgspec.structs.replace(SMALL_BOARD, board="mcu", buses=(), serial=Serial(device="sim"))
    scene = msgspec.structs.replace(HANGING, faults=(scene_faults.BrokenRow(at_s=0, leg="lm", row=1),))
    found = probe(config, scene)
    assert [(diagnosis.location, diagnosis.observation) for diagnosis in found.diagnoses] == [
        ("lm", "the line of row 1 is interrupted")
    ]
    assert [leg.leg for leg in found.legs if leg.unloaded_pf is None] == ["lm"]
    assert probe_json(found)["scan_ms"] is None
    assert "see below" in shown(found)


ADDRESSES = msgspec.structs.replace(
    SMALL_BOARD,
    board="ad7147",
    buses=(
        Bus(device="sim", addresses={"lf": 0x2C, "lm": 0x2D, "lr": 0x2E}),
        Bus(device="sim1", addresses={"rf": 0x2C, "rm": 0x2D, "rr": 0x2E}),
    ),
)


def test_legs_with_an_address_each_are_sound() -> None:
    """Two buses without a multiplexer: the table has each leg's address, and the limits are those of three legs."""
    found = probed(config=ADDRESSES)
    assert found.diagnoses == ()
    assert all(leg.unloaded_pf == pytest.approx([DESIGN.unloaded_pf] * 9, rel=0.015) for leg in found.legs)
    figures, text = probe_json(found), shown(found)
    assert [bus["mux"] for bus in figures["buses"]] == [None, None]
    assert figures["buses"][1]["channels"] == {"0": dict.fromkeys(("0x2c", "0x2d", "0x2e"), "AD7147")}
    assert figures["scan_ms"] == pytest.approx(1.04 * 9 * 0.768, abs=0.01)
    assert [figures["legs"][leg]["address"] for leg in ("lf", "rr")] == ["0x2c", "0x2e"]
    assert text.count("sound") == text.count("AD7147") == 6
    assert max(map(len, text.splitlines())) <= 80
    unloaded = unloaded_yaml(found).splitlines()
    assert len(unloaded) == 7


def test_an_ad7147_behind_a_multiplexer_has_its_channel() -> None:
    config = msgspec.structs.replace(SMALL_BOARD, board="ad7147")
    found = probed(scene_faults.Absent(at_s=0, leg="lm"), config=config)
    (diagnosis,) = found.diagnoses
    assert diagnosis.observation == (
        "channel 1: no answer at 0x2c: broken wire, no supply, or other straps ADD0, ADD1"
    )
    assert shown(found).count("AD7147") == 5


@pytest.mark.parametrize(
    ("broken", "what", "check"),
    [
        (
            scene_faults.Absent(at_s=0, leg="lm"),
            "sim: no answer at 0x2d: broken wire, no supply",
            "straps of another",
        ),
        (scene_faults.WrongChip(at_s=0, leg="lm"), "an AD7147 says 14 70; another chip", "key `board`"),
        (scene_faults.ElementOpen(at_s=0, leg="lm", element=5), "element 5 is open", "to input CIN5"),
        (
            scene_faults.ElementShorted(at_s=0, leg="lm", element=4),
            "element 4 is over the converter's range: its gap is closed, or its line touches ground",
            "water",
        ),
    ],
)
def test_a_fault_beside_legs_on_the_same_wires_is_one_line_on_that_leg(
    broken: Fault, what: str, check: str
) -> None:
    """No mux parts them: the others are found, read and sound all the same."""
    found = probed(broken, config=ADDRESSES)
    (diagnosis,) = found.diagnoses
    assert diagnosis.location == "lm"
    assert what in diagnosis.observation
    assert check in diagnosis.advice
    assert "switch" not in diagnosis.observation + diagnosis.advice
    assert [leg.leg for leg in found.legs if leg.unloaded_pf is None] == ["lm"]
    assert max(map(len, shown(found).splitlines())) <= 80


def test_noise_is_of_new_readings_while_another_bus_is_late() -> None:
    """A leg with corrupt answers delays its bus's first frame; readings that are repeated until then have no noise."""
    found = probed(scene_faults.CorruptReads(at_s=0, leg="lm", rate_rel=0.3), config=ADDRESSES)
    noise_ff = [leg.scans.noise_ff.mean() for leg in found.legs if leg.scans and leg.leg != "lm"]
    assert noise_ff == pytest.approx([1.0] * 5, abs=0.4)
    assert [diagnosis.location for diagnosis in found.diagnoses] == ["lm"]


def test_which_of_several_legs_holds_a_line_nobody_knows() -> None:
    """Of a bus without a multiplexer: it is the bus's fault, and the legs of the other bus are read."""
    found = probed(scene_faults.StuckSda(at_s=0, leg="lm"), config=ADDRESSES)
    (diagnosis,) = found.diagnoses
    assert diagnosis.location == "sim"
    assert diagnosis.observation.startswith("SDA or SCL is held low, by any of lf, lm, lr")
    assert [leg.leg for leg in found.legs if leg.unloaded_pf is not None] == ["rf", "rm", "rr"]
    assert max(map(len, shown(found).splitlines())) <= 80


def test_a_reference_that_is_off_is_the_leg_s_fault() -> None:
    """The leg gives no reading, and the capacitor is named."""
    off = Effects(ad7147=Ad7147Effects(gain_rel=0.5))
    found = probe(ADDRESSES, msgspec.structs.replace(HANGING, effects=off))
    assert 0 < len(found.diagnoses) < 6
    for diagnosis in found.diagnoses:
        assert diagnosis.observation.startswith("its reference capacitor reads ")
        assert diagnosis.observation.endswith("a chip is off by 25% at most")
        assert diagnosis.advice == "the capacitor at CIN12 and its joints"
    silent = [leg.leg for leg in found.legs if leg.unloaded_pf is None]
    assert [diagnosis.location for diagnosis in found.diagnoses] == silent


class Potentiometer:
    """A digital potentiometer: one register, which a write sets and a read repeats."""

    def __init__(self, address: int) -> None:
        self.address = address
        self.wiper = 0x80

    def acknowledges(self, t_ns: int) -> bool:
        return True

    def write(self, data: bytes, t_ns: int) -> None:
        self.wiper = data[-1]

    def read(self, n: int, t_ns: int) -> bytes:
        return bytes((self.wiper,)) * n


def ad7147(address: int = 0x2C) -> SimulatedAd7147:
    return SimulatedAd7147(lambda *_: 5.0, None, address=address)


def test_another_strap_than_configured_is_told() -> None:
    """What answers in its place is named, as far as it is an AD7147; a potentiometer beside it keeps its wiper."""
    other = Potentiometer(0x2E)
    wires = saboteur(None, {0: (ad7147(0x2C), ad7147(0x2F), other)})
    bus = Bus(device="sim", addresses={"lf": 0x2C, "lm": 0x2D})
    found = probed_bus(bus, LegBus(wires, None), wires.clock, AD7147_PLAN, {})
    assert {leg: chips.outcome for leg, chips in found.scan.legs.items()} == {
        "lf": Reading.OK,
        "lm": Reading.NO_ANSWER,
    }
    (told,) = bus_diagnoses(found, AD7147_PLAN)
    assert told.observation == "an AD7147 answers at 0x2f, which is no leg's"
    assert told.advice == "whether it is that of lm: its straps ADD0, ADD1"
    assert other.wiper == 0x80
    assert found.scan.bus_timing is not None


def test_an_ad7147_on_the_channel_of_no_leg_is_told() -> None:
    """Of a leg that the configuration lacks; and a strap of its own on a leg's channel."""
    wires = saboteur(SimulatedMux(MUX), {0: (ad7147(),), 1: (ad7147(0x2D),), 5: (ad7147(),)})
    bus = Bus(device="sim", legs=CHANNELS)  # type: ignore[arg-type]
    found = probed_bus(bus, LegBus(wires, MUX), wires.clock, AD7147_PLAN, {})
    assert [told.observation for told in bus_diagnoses(found, AD7147_PLAN)] == [
        "an AD7147 answers at 0x2d on channel 1, which is no leg's",
        "an AD7147 answers at 0x2c on channel 5, which is no leg's",
    ]


def test_the_range_of_a_foot_is_that_of_all_its_elements() -> None:
    """The open ones of a row too."""
    scene = msgspec.structs.replace(HANGING, faults=(scene_faults.BrokenRow(at_s=0, leg="lm", row=1),))
    picture = shown(probe(SMALL_BOARD, scene))
    assert next(line.split()[-4] for line in picture.splitlines() if line.startswith("lm ")) == "0.84..6.23"


def test_the_column_of_a_shorted_element_is_lost() -> None:
    """Each element is marked in its place; the other legs' readings fit a terminal."""
    found = probed(scene_faults.ElementShorted(at_s=0, leg="lm", element=8))
    assert [mark for mark, faulty in element_marks(found.legs[1]) if faulty] == ["lost", "lost", "short"]
    assert max(map(len, shown(found).splitlines())) <= 80


def test_a_trunk_that_is_held_is_the_bus_s_fault_alone() -> None:
    """Of its legs nothing can be known, and nothing is said."""
    found = probed(scene_faults.StuckUpstreamBus(at_s=0))
    assert [(diagnosis.location, "held low" in diagnosis.observation) for diagnosis in found.diagnoses] == [
        ("sim", True)
    ]
    assert found.scan_period_bound_ns is None
    assert probe_json(found)["legs"]["lf"]["mean_pf"] is None
    assert unloaded_yaml(found) == ""


def test_a_leg_that_nothing_disconnects_hides_those_behind_it() -> None:
    """Without a RESET line the rest of the bus cannot be looked at: that is said, and what to wire."""
    bus = msgspec.structs.replace(SMALL_BOARD.buses[0], mux=Mux())
    found = probed(
        scene_faults.StuckSda(at_s=0, leg="rm"), config=msgspec.structs.replace(SMALL_BOARD, buses=(bus,))
    )
    told = {diagnosis.location: diagnosis for diagnosis in found.diagnoses}
    assert told["sim"].observation.startswith("rr could not be scanned")
    assert "mux.reset" in told["sim"].advice
    assert "channel 4" in told["rm"].observation


def test_a_foot_that_is_pressed_or_another_one_says_by_how_much() -> None:
    """Its readings are offered all the same: only its maker knows whether it hangs free."""
    scene = msgspec.structs.replace(HANGING, load=Constant(force_n=(0.0, 0.0, 0.5)), lead_in_s=0.0)
    found = probe(SMALL_BOARD, scene)
    assert len(found.diagnoses) == 6
    assert "from the expected capacitance of the free foot" in found.diagnoses[0].observation
    assert all(leg.unloaded_pf is not None for leg in found.legs)


class WithOthers:
    """A bus on whose trunk something else answers too."""

    def __init__(self, bus: I2cBus, *addresses: int) -> None:
        self._bus = bus
        self._addresses = addresses

    def transfer(self, transaction: Transaction) -> bytes:
        try:
            return self._bus.transfer(transaction)
        except NackError:
            if transaction.address not in self._addresses:
                raise
            return bytes(transaction.n_read)


MUX = 0x71


def saboteur(mux: SimulatedMux | None, chips: Mapping[int, Sequence[SimulatedChip]]) -> Saboteur:
    """Return a bus with these chips, on which transactions may fail."""
    clock = VirtualClock()
    return Saboteur(SimulatedBus(clock, 400_000, 0, mux, chips), clock)


def test_a_mux_whose_selection_cannot_be_read_is_not_switched() -> None:
    """Another master talks each time that it is asked; what answers on the upstream bus is told all the same."""
    wires = saboteur(SimulatedMux(MUX), {0: (SimulatedFdc1004(lambda *_: 5.0, None),)})
    question = Transaction(MUX, b"", n_read=1)
    wires.arm(lambda transaction, n: I2cError("arbitration lost") if transaction == question else None)
    scan = scan_bus(LegBus(wires, MUX), wires.clock, scan_plan(400), CHANNELS)
    assert scan.upstream is not None
    assert (scan.mux_answers, scan.channels, scan.bus_timing) == (False, {}, None)


def test_a_bus_is_scanned_without_a_write() -> None:
    wires = saboteur(SimulatedMux(MUX), {n: (SimulatedFdc1004(lambda *_: 5.0, None),) for n in range(2)})
    written = []

    def note(transaction: Transaction, n: int) -> None:
        # A write before a read names a register, and an address scan writes nothing.
        if transaction.address != MUX and transaction.write and not transaction.n_read:
            written.append(transaction.write)

    wires.arm(note)
    scan_bus(LegBus(wires, MUX), wires.clock, scan_plan(400), CHANNELS)
    assert written == []


def test_a_bus_that_fails_now_and_then_is_probed_to_the_end() -> None:
    """A time-out while it is timed, and each seventh acknowledge of the mux lost: told, with all that is there."""
    chips = {n: (SimulatedFdc1004(lambda *_: 5.0, None), SimulatedLineSwitch()) for n in range(2)}
    wires = saboteur(SimulatedMux(MUX), chips)
    n_asked = {"long": 0, "mux": 0}

    def fails(transaction: Transaction, n: int) -> I2cError | None:
        n_asked["long"] += transaction.n_read == 33
        n_asked["mux"] += transaction.address == MUX
        if transaction.n_read == 33 and n_asked["long"] == 3:
            return I2cTimeoutError("held low")
        return NackError("lost") if transaction.address == MUX and n_asked["mux"] % 7 == 0 else None

    wires.arm(fails)
    bus, plan = Bus(device="sim", legs=CHANNELS), scan_plan(400)  # type: ignore[arg-type]
    found = probed_bus(bus, LegBus(wires, MUX), wires.clock, plan, {})
    assert {leg: chips.outcome for leg, chips in found.scan.legs.items()} == dict.fromkeys(
        CHANNELS, Reading.OK
    )
    assert found.scan.bus_timing is not None
    (told,) = bus_diagnoses(found, plan)
    assert "passed only when repeated" in told.observation


def test_a_bus_that_fails_without_end_is_a_diagnosis() -> None:
    """And no end of the probe: what stops the scan is told with what to check."""
    wires = saboteur(SimulatedMux(MUX), {})
    wires.arm(lambda transaction, n: I2cTimeoutError("held low") if transaction.n_read == 33 else None)
    bus, plan = Bus(device="sim", legs=CHANNELS), scan_plan(400)  # type: ignore[arg-type]
    found = probed_bus(bus, LegBus(wires, MUX), wires.clock, plan, {})
    (told,) = bus_diagnoses(found, plan)
    assert "the mux (TCA9548A) at 0x71 cannot be reached: held low" in told.observation


@pytest.mark.parametrize(
    ("n_chips", "held", "outcome", "why"),
    [
        (2, False, Reading.OK, ""),
        (1, False, Reading.NO_ANSWER, "no row switch answers at 0x49, though a converter does at 0x50"),
        (0, False, Reading.NO_ANSWER, "no answer at 0x50"),
        (2, True, Reading.BUS_STUCK, "held low"),
    ],
)
def test_a_leg_directly_on_an_adapter(n_chips: int, outcome: Reading, why: str, *, held: bool) -> None:
    """Its chips are those of channel 0; nothing is said of a mux or of what is upstream."""
    chips = (SimulatedFdc1004(lambda *_: 5.0, None), SimulatedLineSwitch())[:n_chips]
    wires = saboteur(None, {0: chips})
    wires.arm(lambda transaction, n: I2cTimeoutError("held low") if held else None)
    plan = scan_plan(400)
    scan = scan_bus(LegBus(wires, None), wires.clock, plan, {"lf": 0})
    assert (scan.upstream, scan.mux_answers, list(scan.channels)) == (AddressProbe(()), True, [0])
    assert scan.legs["lf"].outcome is outcome
    assert scan.legs["lf"].why.startswith(why)
    assert (scan.bus_timing is not None) == (outcome is Reading.OK)
    assert not list(bus_diagnoses(ProbedBus(Bus(device="sim", leg="lf"), scan, {}), plan))


def told_of_bus(
    others: Sequence[int] = (),
    mux_address: int = 0x71,
    rate_hz: int = 400_000,
    legs_on: tuple[int, ...] = (0, 1),
) -> list[str]:
    """Return what is said of a bus that is configured with a mux at 0x71, 400 kHz and two legs."""
    clock, mux = VirtualClock(), SimulatedMux(mux_address)
    chips = {channel: (SimulatedFdc1004(lambda *_: 5.0, None), SimulatedLineSwitch()) for channel in legs_on}
    wires = WithOthers(SimulatedBus(clock, rate_hz, 0, mux, chips), *others)
    plan = scan_plan(400)
    bus = Bus(device="sim", legs=CHANNELS)  # type: ignore[arg-type]
    seen = scan_bus(LegBus(wires, 0x71), clock, plan, CHANNELS)
    return [
        f"{diagnosis.observation}; check {diagnosis.advice}"
        for diagnosis in bus_diagnoses(ProbedBus(bus, seen, {}), plan)
    ]


@pytest.mark.parametrize(
    ("bus", "says"),
    [
        ({}, None),
        ({"others": [0x50]}, "something answers at 0x50 with no leg connected"),
        ({"rate_hz": 100_000}, "it runs at 100 kHz, 400 kHz are configured; check dtparam"),
        ({"mux_address": 0x74}, "no mux (TCA9548A) answers at 0x71; 0x74 does; check its address"),
        ({"others": [0x71], "mux_address": 0x74}, "the chip at 0x71 does not read back what is written"),
        ({"legs_on": (0, 5)}, "a leg's chips answer on channel 5, which is no leg's; check whether they are"),
    ],
)
def test_what_is_wrong_with_a_bus_is_one_line(bus: dict[str, Any], says: str | None) -> None:
    """A clash of addresses, a slow clock, a mux elsewhere, and a leg on another channel than configured."""
    lines = told_of_bus(**bus)
    assert len(lines) == (says is not None)
    assert all(line.startswith(says or "") for line in lines)
