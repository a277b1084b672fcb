"""Board `ad7147` as its bus and a user see it: whatever the chip, the host or the wires do, a reading is right or none.

The feet are pressed and let go, each element and leg by another capacitance, so that a reading of another conversion,
element or leg shows.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from firmware_interface.chips import ad7147 as chip
from firmware_interface.chips.ad7147 import Ad7147Register, InputConnection
from footsense.acquisition.free_scanner import FreeScanner
from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.robot_scanner import RobotScanner
from footsense.acquisition.scan_plan import AD7147_PLAN
from footsense.errors import I2cError, I2cTimeoutError, NackError
from footsense.frames import ELEMENTS, CapFrame, Reading
from footsense.ports import Transaction
from footsense.sim.chips.ad7147 import SimulatedAd7147
from footsense.sim.chips.chip import SimulatedChip, SimulatedMux
from footsense.sim.clock import JoinedClock, VirtualClock
from footsense.sim.faults import scene_faults
from footsense.sim.faults.chip_faults import inject_chip_faults
from footsense.sim.faults.scene_faults import ChipFault, StuckSda
from footsense.sim.faults.wire_faults import WireFaults
from footsense.sim.i2c_bus import SimulatedBus
from footsense.sim.scene import Ad7147Effects
from tests.contract.boards import TIMEOUT_NS, LateError, Saboteur

MUX, MS_NS, S_NS = 0x71, 1_000_000, 1_000_000_000
N_LEGS = 6
REFERENCE_PF = 4.7
#: Rise of the capacitances in half a period [pF]: 83 fF in a sequence, 9 fF in a stage.
RISE_PF, PERIOD_NS = 6.0, S_NS


def true_pf(leg: NDArray[np.int_], element: NDArray[np.int_], t_ns: NDArray[np.int_]) -> NDArray[np.float64]:
    """Return the capacitance of elements of legs at times [pF]."""
    phase = np.mod(t_ns / PERIOD_NS, 1.0)
    pressed = 1.0 - np.abs(2.0 * phase - 1.0)
    return np.asarray(4.0 + RISE_PF * pressed + 0.04 * element + 0.013 * leg)


class Wiring(NamedTuple):
    """Buses, and whether each leg has an address or a channel of its own."""

    n_buses: int
    has_mux: bool


ADDRESSES, CHANNELS, ONE_MUX = Wiring(2, has_mux=False), Wiring(2, has_mux=True), Wiring(1, has_mux=True)
wirings = pytest.mark.parametrize(
    "wiring",
    [
        pytest.param(ADDRESSES, id="addresses"),
        pytest.param(CHANNELS, id="channels", marks=pytest.mark.slow),
        pytest.param(ONE_MUX, id="one-mux", marks=pytest.mark.slow),
    ],
)
with_mux = pytest.mark.parametrize(
    "wiring",
    [pytest.param(CHANNELS, id="channels"), pytest.param(ONE_MUX, id="one-mux", marks=pytest.mark.slow)],
)
QUIET = Ad7147Effects(noise_ff=0.0)


class Host(Saboteur):
    """A computer that delays transactions before and behind them, and stalls now and then."""

    jitter_ns = stalls_rel = 0.0

    def transfer(self, transaction: Transaction) -> bytes:
        self._delay()
        answer = super().transfer(transaction)
        self._delay()
        return answer

    def _delay(self) -> None:
        if self.jitter_ns or self.stalls_rel:
            self.clock.advance_ns(round(self.random.uniform(0, self.jitter_ns)))
            if self.random.random() < self.stalls_rel:
                self.clock.advance_ns(round(self.random.exponential(6 * MS_NS)))

    def __init__(self, bus: SimulatedBus, clock: VirtualClock, random: np.random.Generator) -> None:
        super().__init__(bus, clock)
        self.random = random


class Robot:
    """Six legs with an AD7147 each, their buses and scanner."""

    def __init__(
        self,
        wiring: Wiring = ADDRESSES,
        effects: Ad7147Effects = QUIET,
        *,
        host_cost_us: int | None = None,
        jitter_us: float = 0.0,
        stalls_rel: float = 0.0,
        bus_hz: int = 400_000,
        clock_rel: float = 0.04,
        gain_rel: float = 0.25,
        reference_pf: float = REFERENCE_PF,
        faults: Sequence[ChipFault] = (),
        wire_faults: Sequence[StuckSda] = (),
        straps: dict[int, int] | None = None,
        seed: int = 1,
    ) -> None:
        """Faults are of leg 3, `lf` in them; `straps` are the addresses of chips that are not as configured."""
        if host_cost_us is None:  # what the bus carries
            host_cost_us = 40 if wiring is ONE_MUX else 100
        random = np.random.default_rng(seed)
        self.noise_ff, self.reference_pf = effects.noise_ff, np.full(N_LEGS, reference_pf)
        self.legs = np.arange(N_LEGS)
        self.chips: list[SimulatedAd7147] = []
        self.muxes: list[SimulatedMux] = []
        self.hosts: list[Host] = []
        self.scanners: list[FreeScanner] = []
        clocks = [VirtualClock() for _ in range(wiring.n_buses)]
        per_bus = N_LEGS // wiring.n_buses
        for clock in clocks:
            behind: dict[int, list[SimulatedChip]] = {}
            channels, addresses = {}, {}
            for n in range(per_bus):
                leg = len(self.chips)
                address = chip.ADDRESSES[0 if wiring.has_mux else n]
                gain, offset, rate = random.choice((-1.0, 0.3, 1.0), 3)
                self.chips.append(
                    SimulatedAd7147(
                        self._input_pf(leg),
                        np.random.default_rng((seed, leg)) if effects.noise_ff else None,
                        clock_rel * rate,
                        address=(straps or {}).get(leg, address),
                        effects=effects,
                        gain_rel=gain_rel * gain,
                        offset_rel=gain_rel * offset,
                        bus_clock_hz=bus_hz,
                        shifts=np.random.default_rng((seed, leg, 1)),
                    )
                )
                own = inject_chip_faults(self.chips[-1], None, faults if leg == 3 else (), random)
                channel = n if wiring.has_mux else 0
                behind.setdefault(channel, []).extend(own)
                channels[f"leg {leg}"], addresses[f"leg {leg}"] = channel, address
            mux = SimulatedMux(MUX) if wiring.has_mux else None
            self.muxes += [mux] if mux else []
            is_broken = len(self.chips) > 3 and wire_faults
            breaks = WireFaults(wire_faults, {"lf": 3 % per_bus if mux else 0}, TIMEOUT_NS, random)
            bus = SimulatedBus(clock, bus_hz, 1000 * host_cost_us, mux, behind, breaks if is_broken else None)
            self.hosts.append(Host(bus, clock, random))
            self.hosts[-1].jitter_ns, self.hosts[-1].stalls_rel = 1e3 * jitter_us, stalls_rel
            leg_bus = LegBus(self.hosts[-1], MUX if mux else None, mux)
            self.scanners.append(FreeScanner(leg_bus, clock, channels, addresses, AD7147_PLAN))
        self.clock = JoinedClock(clocks, AD7147_PLAN.conversion_wait_ns)
        self.scanner = RobotScanner(self.scanners)
        self.scanner.start()

    def _input_pf(self, leg: int) -> Callable[[int, tuple[InputConnection, ...], int, int], float]:
        def input_pf(cin: int, connections: tuple[InputConnection, ...], from_ns: int, to_ns: int) -> float:
            stray_pf = 0.5 * (chip.N_INPUTS - 1 - connections.count(InputConnection.BIAS))
            if cin == 12:
                return float(self.reference_pf[leg]) + stray_pf
            phase = (from_ns + to_ns) / 2 / PERIOD_NS % 1.0  # as `true_pf`
            found_pf: float = (
                4.0
                + RISE_PF * (1.0 - abs(2.0 * phase - 1.0))
                + 0.04 * cin
                + 0.013 * self.legs[leg]
                + stray_pf
            )
            return found_pf

        return input_pf

    def read(self) -> CapFrame:
        """Return the next frame, after making sure that each of its readings is right, or none."""
        frame = self.scanner.read()
        now_ns = max(host.clock.now_ns() for host in self.hosts)
        self.clock.now_ns()
        is_ok = frame.reading == Reading.OK
        leg, element = np.nonzero(is_ok)
        t_ns = frame.t_ns[is_ok]
        error_ff = 1e3 * np.abs(frame.capacitance_pf[is_ok] - true_pf(self.legs[leg], element, t_ns))
        assert error_ff.max(initial=0.0) < 6.0 + 6.0 * self.noise_ff
        assert ((t_ns > 0) & (t_ns < now_ns)).all()
        assert np.isnan(frame.capacitance_pf[~is_ok]).all()
        return frame

    def read_for(self, s: float) -> list[tuple[int, NDArray[np.uint8], NDArray[np.int64]]]:
        """Return times, readings and stamps of all frames for some time."""
        until_ns, frames = self.clock.now_ns() + s * S_NS, []
        while self.clock.now_ns() < until_ns:
            frame = self.read()
            frames.append((self.clock.now_ns(), frame.reading, frame.t_ns))
        return frames


kinds = st.builds(
    Ad7147Effects,
    noise_ff=st.sampled_from((0.3, 1.0, 3.0)),
    coherent_bursts=st.booleans(),
    torn_words=st.booleans(),
    complete_needs_enable=st.booleans(),
    junk_sequences=st.integers(0, 2),
    calibration_moves_results=st.booleans(),
    shifted_burst_rel=st.sampled_from((0.0, 0.02)),
)
runs = given(
    wiring=st.sampled_from((ADDRESSES, CHANNELS, ONE_MUX)),
    effects=kinds,
    bus_hz=st.sampled_from((400_000, 400_000, 100_000)),
    host_cost_us=st.sampled_from((40, 100, 150)),
    jitter_us=st.sampled_from((0.0, 50.0, 200.0)),
    stalls_rel=st.sampled_from((0.0, 0.001, 0.01)),
    seed=st.integers(0, 1000),
)


def check_a_kind(**case: object) -> None:
    robot = Robot(**case)  # type: ignore[arg-type]
    calm = case["bus_hz"] == 400_000 and not case["stalls_rel"]
    shares = [np.mean(reading == Reading.OK) for _, reading, _ in robot.read_for(0.5)]
    if calm:
        assert np.mean(shares) > 0.97, case


@runs
@settings(max_examples=6)
def test_of_no_kind_of_chip_a_reading_is_of_another_conversion(**case: object) -> None:
    """With clocks, gains and offsets that are off, torn words, shifted bursts, junk, and a host that stalls."""
    check_a_kind(**case)


@pytest.mark.slow
@runs
@settings(max_examples=60)
def test_of_no_kind_of_chip_a_reading_is_of_another_conversion_in_many_cases(**case: object) -> None:
    """The same, searched for longer."""
    check_a_kind(**case)


@wirings
def test_gain_and_offset_are_those_of_the_reference(wiring: Wiring) -> None:
    """Of chips that are a quarter off; a capacitor that is off by one percent takes the readings along."""
    robot = Robot(wiring, clock_rel=0.0)
    frame = robot.read()
    assert (frame.reading == Reading.OK).all()
    robot = Robot(wiring, clock_rel=0.0, reference_pf=1.01 * REFERENCE_PF)
    frame = robot.scanner.read()
    right_pf = true_pf(np.arange(N_LEGS)[:, None], np.arange(ELEMENTS), frame.t_ns)
    np.testing.assert_allclose(frame.capacitance_pf, right_pf / 1.01, rtol=1.5e-3)


@pytest.mark.parametrize(
    ("reference_pf", "line"),
    [
        (1.32 * REFERENCE_PF, "its reference capacitor reads 6.2 pF, and has 4.7 pF"),
        (0.68 * REFERENCE_PF, "its reference capacitor reads 3.2 pF"),
        (0.0, "its reference capacitor reads 0.0 pF"),
        (-0.05, "its reference capacitor reads 0.0 pF"),
        (1e6, "its reference capacitor reads 8.0 pF"),
    ],
    ids=["high", "low", "missing", "missing-and-offset", "shorted"],
)
def test_a_leg_whose_reference_is_wrong_is_left_out_with_its_line(
    reference_pf: float, line: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Nothing tells what its codes are worth; the others have every reading."""
    robot = Robot(gain_rel=0.0)
    robot.reference_pf[3] = reference_pf
    robot.scanner.start()
    for _, reading, _ in robot.read_for(1.0)[20:]:
        assert (reading[3] == Reading.MISCONFIGURED).all()
        assert (np.delete(reading, 3, axis=0) == Reading.OK).all()
    lines = {record.message for record in caplog.records if "reference" in record.message}
    assert len(lines) == 1
    assert f"leg leg 3: {line}" in lines.pop()
    robot.reference_pf[3] = REFERENCE_PF
    assert (robot.read_for(4.2)[-1][1] == Reading.OK).all()


class Outage(NamedTuple):
    """What a leg had for how long.

    Attributes:
        seen: Readings other than OK.
        shown_ns: Time until the first of them [ns].
        over_ns: Time until the last of them [ns].
    """

    seen: set[Reading]
    shown_ns: int
    over_ns: int


def outage(
    robot: Robot, s: float, *, bad: tuple[int, ...] = (3,), pause_ms: float = 25.0, loses_count: bool = False
) -> Outage:
    """Return what legs had for some time, in the end all OK; the others have a new reading within a pause."""
    start_ns = robot.clock.now_ns()
    seen: set[Reading] = set()
    shown_ns = over_ns = 0
    newest_ns = np.full(N_LEGS, start_ns)
    for now_ns, reading, t_ns in robot.read_for(s):
        others = [leg for leg in range(N_LEGS) if leg not in bad]
        assert np.isin(reading[others], (Reading.OK, Reading.NOT_READY) if loses_count else Reading.OK).all()
        newest_ns = np.maximum(newest_ns, t_ns.max(axis=1))
        assert (now_ns - newest_ns[others]).max() < pause_ms * MS_NS
        missing = {Reading(each) for each in reading[list(bad)].ravel().tolist()} - {Reading.OK}
        if missing:
            shown_ns, over_ns = shown_ns or now_ns - start_ns, now_ns - start_ns
        seen |= missing
    assert (reading == Reading.OK).all()
    return Outage(seen, shown_ns, over_ns)


@wirings
@pytest.mark.parametrize("lasts_ms", [30, 200])
def test_a_leg_that_is_gone_is_found_again(wiring: Wiring, lasts_ms: int) -> None:
    """A cable that breaks for 30 ms costs as much; after a longer time the leg is tried in turn."""
    robot = Robot(wiring)
    robot.read()
    now_ns = robot.clock.now_ns()
    robot.chips[3].absent_ns = [(now_ns, now_ns + lasts_ms * MS_NS)]
    seen = outage(robot, 1.5)
    assert Reading.NO_ANSWER in seen.seen <= {Reading.NO_ANSWER, Reading.NOT_READY}
    assert seen.shown_ns < 10 * MS_NS
    assert seen.over_ns < (55 if lasts_ms == 30 else 450) * MS_NS


@wirings
def test_another_chip_in_the_place_of_one_is_measured_anew(wiring: Wiring) -> None:
    """Its gain and its steps of the offset are its own."""
    robot = Robot(wiring)
    robot.read()
    now_ns, swapped = robot.clock.now_ns(), robot.chips[3]
    swapped.absent_ns = [(now_ns, now_ns + 150 * MS_NS)]
    swapped.brown_outs_ns = [now_ns + 150 * MS_NS]
    robot.read_for(0.1)
    swapped._codes_per_pf, swapped._offset_step_pf, swapped.clock_factor = 3400.0, 0.37, 0.97
    assert outage(robot, 1.0).seen <= {Reading.NO_ANSWER, Reading.NOT_READY}


@wirings
@pytest.mark.parametrize("after_us", [0, 900, 2500])
def test_a_chip_that_was_reset_is_started_again(wiring: Wiring, after_us: int) -> None:
    """Its status does not fit: that costs three scans, and no other leg anything."""
    robot = Robot(wiring, Ad7147Effects(noise_ff=1.0, junk_sequences=2, calibration_moves_results=True))
    robot.read()
    robot.chips[3].brown_outs_ns = [robot.clock.now_ns() + 1000 * after_us]
    seen = outage(robot, 0.4)
    assert seen.seen <= {Reading.MISCONFIGURED, Reading.UNDER_RANGE, Reading.NOT_READY}
    assert Reading.MISCONFIGURED in seen.seen
    assert seen.shown_ns < 16 * MS_NS
    assert seen.over_ns - seen.shown_ns < 80 * MS_NS


@wirings
def test_a_sequence_that_hangs_is_ended_by_a_reset(wiring: Wiring) -> None:
    """It holds its settings and converts nothing."""
    robot = Robot(wiring)
    robot.read()
    robot.chips[3].hangs_ns = [robot.clock.now_ns()]
    seen = outage(robot, 1.0)
    assert seen.seen == {Reading.NOT_READY}
    assert seen.shown_ns < 40 * MS_NS
    assert seen.over_ns < 450 * MS_NS


def test_a_chip_that_does_not_convert_is_left_out_until_it_does() -> None:
    robot = Robot()
    robot.read()
    now_ns = robot.clock.now_ns()
    robot.chips[3].stuck_ns = [(now_ns, now_ns + S_NS)]
    seen = outage(robot, 4.0)
    assert seen.seen == {Reading.NOT_READY}
    assert seen.over_ns < 3 * S_NS


@pytest.mark.parametrize(
    ("register", "word"),
    [
        *((chip.stage_register(k) + n, 0x1234) for k in (0, 8) for n in range(3)),
        (Ad7147Register.PWR_CONTROL, chip.power_control(9, 128)),
        (Ad7147Register.PWR_CONTROL, chip.power_control(5, 64)),
        (Ad7147Register.PWR_CONTROL, 1),
        (Ad7147Register.STAGE_CAL_EN, 0x0FFF),
    ],
)
def test_a_setting_that_has_changed_is_found_and_set_again(register: int, word: int) -> None:
    """Each block of registers is read back in its turn, all of them within ten scans of each leg of the bus."""
    robot = Robot(effects=Ad7147Effects(noise_ff=0.0, calibration_moves_results=True))
    robot.read()
    robot.chips[3].write(chip.write_bytes(register, word), robot.clock.now_ns())
    until_ns = robot.clock.now_ns() + 32 * AD7147_PLAN.scan_ns
    seen = set()
    while robot.clock.now_ns() < until_ns:
        frame = robot.scanner.read()  # until then its readings may be wrong
        seen |= set(frame.reading[3].tolist())
        assert (np.delete(frame.reading, 3, axis=0) == Reading.OK).all()
        robot.clock.now_ns()
    assert Reading.MISCONFIGURED in seen
    assert (robot.read_for(0.1)[-1][1] == Reading.OK).all()


def _in_span(kind: Callable[..., ChipFault], **values: float) -> ChipFault:
    return kind(leg="lf", at_s=0.3, until_s=0.8, **values)


@wirings
def test_another_kind_of_chip_is_told_by_its_identity(
    wiring: Wiring, caplog: pytest.LogCaptureFixture
) -> None:
    """Its set-up is tried ten times, each of which delays the others of its bus by 4 ms."""
    robot = Robot(wiring, faults=[_in_span(scene_faults.WrongChip)])
    seen = outage(robot, 2.5, pause_ms=40.0, loses_count=True)
    assert Reading.WRONG_CHIP in seen.seen
    assert "such as a potentiometer" in caplog.text
    assert seen.over_ns < 1.8 * S_NS


@wirings
@pytest.mark.parametrize("rate_rel", [0.02, 0.3])
def test_acknowledges_that_are_lost_cost_no_right_reading(wiring: Wiring, rate_rel: float) -> None:
    robot = Robot(wiring, faults=[_in_span(scene_faults.NackAtRandom, rate_rel=rate_rel)])
    seen = outage(robot, 3.0)
    assert seen.seen <= {Reading.NO_ANSWER, Reading.MISCONFIGURED, Reading.NOT_READY}
    if rate_rel < 0.1:
        assert seen.over_ns < 0.85 * S_NS


def test_reads_with_a_wrong_bit_leave_one_wrong_reading_at_most() -> None:
    """Nothing tells which bit of a result is wrong; its stamp and the other elements are right."""
    robot = Robot(faults=[_in_span(scene_faults.CorruptReads, rate_rel=0.05)])
    n_wrong = n = 0
    while robot.clock.now_ns() < 1.5 * S_NS:
        frame = robot.scanner.read()
        robot.clock.now_ns()
        right_pf = true_pf(np.arange(N_LEGS)[:, None], np.arange(ELEMENTS), frame.t_ns)
        wrong = np.abs(frame.capacitance_pf - right_pf) > 0.006
        n_wrong, n = n_wrong + int(wrong.sum()), n + 1
        assert wrong.sum() <= 3
        assert not np.delete(wrong, 3, axis=0).any()
        assert (np.delete(frame.reading, 3, axis=0) == Reading.OK).all()
    assert n_wrong < 0.2 * n
    assert (frame.reading == Reading.OK).all()


@with_mux
def test_a_leg_that_holds_sda_low_behind_a_mux_costs_the_others_two_timeouts(wiring: Wiring) -> None:
    robot = Robot(wiring, wire_faults=[StuckSda(leg="lf", at_s=0.3, until_s=0.8)])
    seen = outage(robot, 4.5, pause_ms=5 * TIMEOUT_NS / MS_NS, loses_count=True)
    assert Reading.BUS_STUCK in seen.seen <= {Reading.BUS_STUCK, Reading.NOT_READY}


def test_legs_without_a_mux_are_stuck_together_and_come_back() -> None:
    """Those of the other bus have every reading."""
    robot = Robot(wire_faults=[StuckSda(leg="lf", at_s=0.3, until_s=0.8)])
    seen = outage(robot, 2.5, bad=(3, 4, 5), pause_ms=3 * TIMEOUT_NS / MS_NS)
    assert Reading.BUS_STUCK in seen.seen <= {Reading.BUS_STUCK, Reading.NOT_READY}
    assert seen.over_ns < 1.7 * S_NS


def test_of_two_chips_at_one_address_no_reading_is_ok(caplog: pytest.LogCaptureFixture) -> None:
    """The other address does not answer, which is said with its usual cause."""
    robot = Robot(straps={4: chip.ADDRESSES[0]})
    for _, reading, _ in robot.read_for(2.0):
        assert (reading[[0, 1, 2, 5]] == Reading.OK).all()
        assert (reading[4] == Reading.NO_ANSWER).all()
        assert (reading[3] != Reading.OK).all()
    assert "leg leg 4: no answer at 0x2d: broken wire, no supply, or other straps ADD0, ADD1" in caplog.text


@with_mux
@pytest.mark.parametrize("after_us", [0, 1900])
def test_a_mux_that_keeps_its_channels_is_noticed(
    wiring: Wiring, after_us: int, caplog: pytest.LogCaptureFixture
) -> None:
    """Within two scans of its bus; then only the leg that it does connect may have readings."""
    robot = Robot(wiring)
    robot.read()
    now_ns = robot.clock.now_ns() + 1000 * after_us
    robot.muxes[-1].keeps_channels_ns = [(now_ns, now_ns + S_NS)]
    behind = range(N_LEGS - N_LEGS // wiring.n_buses, N_LEGS)
    while robot.clock.now_ns() < now_ns + 0.95 * S_NS:
        frame = robot.scanner.read()
        robot.clock.now_ns()
        if robot.clock.now_ns() > now_ns + 3 * 9 * MS_NS:
            ok = (frame.reading == Reading.OK).any(axis=1)
            assert ok[list(behind)].sum() <= 1
            assert ok[: behind[0]].all()
            right_pf = true_pf(np.arange(N_LEGS)[:, None], np.arange(ELEMENTS), frame.t_ns)
            assert not (np.abs(frame.capacitance_pf - right_pf) > 0.006).any()
    assert "its multiplexer acknowledges other channels than it connects" in caplog.text
    assert (robot.read_for(5.0)[-1][1] == Reading.OK).all()


TROUBLES = st.lists(
    st.tuples(
        st.integers(0, 600),  # transaction at which it begins
        st.integers(1, 60),  # transactions that it lasts
        st.sampled_from(
            [NackError("no acknowledge"), I2cError("garbled"), I2cTimeoutError("held low"), LateError("late")]
        ),
    ),
    max_size=5,
)
CHIP_FAULTS = st.lists(
    st.tuples(
        st.sampled_from(["absent", "brown_out", "stuck", "hang"]), st.integers(0, 5), st.floats(0.01, 0.15)
    ),
    max_size=4,
)


@given(st.sampled_from((ADDRESSES, CHANNELS, ONE_MUX)), TROUBLES, CHIP_FAULTS, st.booleans())
@settings(max_examples=6)
def test_whatever_fails_a_reading_is_right_or_missing(
    wiring: Wiring,
    troubles: list[tuple[int, int, I2cError]],
    chip_faults: list[tuple[str, int, float]],
    from_start: bool,  # noqa: FBT001 - drawn
) -> None:
    """Random failures of bus and chips, as legs are set up and later: no wrong number, and all is well in the end."""
    robot = Robot(wiring, Ad7147Effects(noise_ff=1.0, junk_sequences=2, torn_words=True))

    def fails(transaction: Transaction, n: int) -> I2cError | None:
        del transaction
        return next((error for begin, length, error in troubles if begin <= n < begin + length), None)

    if not from_start:
        robot.read_for(0.1)
    robot.hosts[-1].arm(fails)
    for kind, leg, at_s in chip_faults:
        at_ns = robot.clock.now_ns() + round(at_s * S_NS)
        hit = robot.chips[leg]
        if kind == "absent":
            hit.absent_ns.append((at_ns, at_ns + 30 * MS_NS))
        elif kind == "brown_out":
            hit.brown_outs_ns.append(at_ns)
        elif kind == "stuck":
            hit.stuck_ns.append((at_ns, at_ns + 60 * MS_NS))
        else:
            hit.hangs_ns.append(at_ns)
    robot.read_for(0.3)
    robot.hosts[-1].arm(lambda transaction, n: None)
    until_ns = robot.clock.now_ns() + 6 * S_NS
    while (robot.read().reading != Reading.OK).any():
        assert robot.clock.now_ns() < until_ns
