import math
from datetime import date

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_interface.can.codes import (
    USABLE,
    BaselineStatus,
    CalibrationKind,
    CommandKind,
    GaitEventKind,
    State,
    StepPhase,
)
from firmware_interface.can.commands import (
    COMMAND,
    COMMAND_ID,
)
from firmware_interface.can.crc8 import FrameError, protect
from firmware_interface.can.force import FORCE, FORCE_ID, QUALITY, QUALITY_ID, force_step_mn
from firmware_interface.can.gait import (
    GAIT_EVENT,
    GROUND,
    LEG_MOTION,
    LEG_MOTION_ID,
    GaitEventFrame,
    Ground,
    LegMotionFrame,
)
from firmware_interface.can.reports import (
    BASELINE,
    BASELINE_ID,
    CALIBRATION,
    CALIBRATION_ID,
    HEARTBEAT_ID,
    Baseline,
    CalibrationFrame,
    decode_heartbeat,
)
from footsense.estimation.pipeline import MAX_SIGMA_REL
from tests.support.can_frames import encode_force, encode_quality

nodes = st.integers(1, 8)
counters = st.integers(0, 14)
probabilities = st.one_of(st.just(math.nan), st.floats(0.0, 1.0))
numbers = st.floats(allow_nan=False)
vectors = st.tuples(numbers, numbers, numbers)
forces = st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3)


@given(nodes, counters, st.sampled_from(sorted(USABLE)), forces)
@example(6, 14, State.VALID, (1e300, -1e300, 32.7671))
@example(1, 0, State.DEGRADED, (-32.768, 0.0005, -0.0))
def test_a_usable_force_comes_back_saturated_and_within_half_a_bit(
    node: int, counter: int, state: State, force_n: tuple[float, float, float]
) -> None:
    """decode(encode(x)) is x, limited to +-32.767 N and rounded to 1 mN; it is never `no value`."""
    decoded = FORCE.decode(FORCE_ID + node, encode_force(node, counter, state, force_n))
    assert (decoded.node, decoded.counter, decoded.state) == (node, counter, state)
    for wire_n, true_n in zip(decoded.force_n, force_n, strict=True):
        assert wire_n == pytest.approx(max(-32.767, min(32.767, true_n)), abs=0.5001e-3)


@given(st.sampled_from([state for state in State if state not in USABLE]), vectors)
def test_no_force_leaves_under_a_state_that_forbids_it(
    state: State, force_n: tuple[float, float, float]
) -> None:
    """Whatever stands in the frame, a consumer sees no number unless the state is usable."""
    decoded = FORCE.decode(0x109, encode_force(1, 0, state, force_n))
    assert decoded.state == state
    assert all(math.isnan(component) for component in decoded.force_n)


@pytest.mark.parametrize("state", sorted(USABLE))
@pytest.mark.parametrize("hole", [math.nan, math.inf, -math.inf])
def test_a_usable_force_with_a_hole_leaves_as_a_fault_without_numbers(hole: float, state: State) -> None:
    """A consumer that looks at the state alone must read neither -32.768 N nor a load that nobody measured.

    The same holds for a sigma that is not known; one that is too large for its field is.
    """
    pairs = [((0.1, hole, 40.0), (0.1, 0.1, 0.1)), ((0.1, 0.2, 40.0), (0.1, 0.1, hole))]
    for force_n, sigma_n in pairs[: 1 if hole == math.inf else 2]:
        decoded = FORCE.decode(0x109, encode_force(1, 0, state, force_n, sigma_n))
        assert decoded.state == State.ELEMENT_FAULT
        assert all(math.isnan(component) for component in decoded.force_n)


@given(
    st.tuples(nodes, counters, st.integers(0, 15)),
    st.one_of(st.none(), st.integers()),
    vectors,
    st.tuples(probabilities, probabilities),
)
@example((1, 0, 0), 409_400_000, (0.0, 0.001, 0.00100001), (0.0, 1.0))
@example((1, 0, 0), 409_400_001, (50.5351650, 55.108988, math.inf), (0.004, 0.996))
def test_quality_comes_back_saturated_and_never_better_than_it_was(
    head: tuple[int, int, int],
    age_ns: int | None,
    sigma_n: tuple[float, float, float],
    contact: tuple[float, float],
) -> None:
    """Age and sigma are rounded up, by less than 9.1 % and 0.1 ms; no value stays no value."""
    decoded = QUALITY.decode(QUALITY_ID + head[0], encode_quality(*head, age_ns, sigma_n, *contact))
    assert decoded[:3] == head
    assert (decoded.contact_probability, decoded.holds) == pytest.approx(contact, abs=0.00501, nan_ok=True)
    if age_ns is None or not 0 <= age_ns <= 409_400_000:
        assert decoded.age_ns is None
    else:
        assert decoded.age_ns is not None
        assert age_ns <= decoded.age_ns < age_ns + 100_000
    for wire_n, true_n in zip(decoded.sigma_n, sigma_n, strict=True):
        if true_n < 0:
            assert math.isnan(wire_n)
        else:
            sent_n = min(max(true_n, 0.001), 55.108988)
            assert sent_n <= wire_n < 1.0916 * sent_n


@pytest.mark.parametrize("max_n", [28.8, 187.5])
def test_the_largest_sigma_of_a_usable_force_fits(max_n: float) -> None:
    """Half of the range, of the released feet for the smallest and the largest forces, in their step."""
    largest_n = MAX_SIGMA_REL * max_n / force_step_mn(max_n)
    quality = QUALITY.decode(QUALITY_ID + 1, encode_quality(1, 0, 0, 0, (largest_n,) * 3))
    assert largest_n <= quality.sigma_n[0] < QUALITY.signals["sigma_n"].to_value(126 * 0x4081)[0]


@given(
    *(nodes, counters, st.sampled_from(StepPhase), st.floats(), st.floats()),
    *(st.floats(0.0, 1.0), st.floats(0.0, 2.0 * math.pi)),
)
def test_a_motion_comes_back_within_half_a_bit_and_never_surer(
    node: int, counter: int, phase: StepPhase, acceleration: float, sigma: float, tilt: float, azimuth: float
) -> None:
    """Any acceleration leaves as one of its range, or as none; up stays a unit vector."""
    up = tilt * math.cos(azimuth), tilt * math.sin(azimuth), math.sqrt(1.0 - tilt * tilt)
    sent = LegMotionFrame(node, counter, phase, acceleration, sigma, up)
    motion = LEG_MOTION.decode(LEG_MOTION_ID + node, LEG_MOTION.encode(sent))
    assert motion[:3] == sent[:3]
    limited = acceleration if math.isnan(acceleration) else max(-327.67, min(327.67, acceleration))
    assert motion.acceleration_m_per_s2 == pytest.approx(limited, abs=0.00501, nan_ok=True)
    if sigma >= 0.0:
        assert min(sigma, 551.0) <= motion.sigma_m_per_s2
    else:
        assert math.isnan(motion.sigma_m_per_s2)
    assert motion.up[:2] == pytest.approx(up[:2], abs=0.000501)
    assert math.hypot(*motion.up) == pytest.approx(1.0, abs=0.001)


def test_a_calibration_tells_its_date() -> None:
    """Days since 2020-01-01; none without a calibration; expected errors are rounded up."""
    pressed = CalibrationFrame(2, 3, CalibrationKind.PRESSED, 2159, 2.1, 1.41)
    read = CALIBRATION.decode(CALIBRATION_ID + 2, CALIBRATION.encode(pressed))
    assert (read.date, read.size_error_percent, read.direction_error_deg) == (date(2025, 11, 29), 2.5, 1.5)
    none = CalibrationFrame(2, 3, CalibrationKind.NONE, None, math.nan, math.nan)
    assert CALIBRATION.decode(CALIBRATION_ID + 2, CALIBRATION.encode(none)).date is None


@given(
    nodes, counters, st.sampled_from(BaselineStatus), numbers, numbers, st.one_of(st.none(), st.integers())
)
@example(1, 0, BaselineStatus.HELD, -3.2768, math.inf, 6_553_400_000_000)
@example(1, 0, BaselineStatus.HELD, 0.00005, 1e-9, 1)
def test_a_zero_comes_back_saturated_and_never_younger(
    node: int, counter: int, status: BaselineStatus, mean_pf: float, worst_pf: float, age_ns: int | None
) -> None:
    """Offsets are limited to +-3276.7 fF and rounded, the age is rounded up; none is taken for `no value`."""
    zero = BASELINE.decode(
        BASELINE_ID + node, BASELINE.encode(Baseline(node, counter, status, mean_pf, worst_pf, age_ns))
    )
    assert zero[:3] == (node, counter, status)
    for wire_pf, true_pf in ((zero.mean_pf, mean_pf), (zero.worst_pf, worst_pf)):
        assert wire_pf == pytest.approx(max(-3.2767, min(3.2767, true_pf)), abs=0.5001e-4)
    if age_ns is None or age_ns < 0:
        assert zero.age_ns is None
    else:
        assert zero.age_ns is not None
        assert min(age_ns, 6_553_400_000_000) <= zero.age_ns < age_ns + 100_000_000


def test_a_command_needs_the_word_that_fits_its_kind() -> None:
    """A whole frame that spells another word asks for nothing, and says which kind it had."""
    stop_as_zero = protect(COMMAND_ID + 1, bytes([4, CommandKind.STOP, 0]) + b"zero")
    frame = COMMAND.decode(COMMAND_ID + 1, stop_as_zero)
    assert (frame.kind, frame.counter, frame.is_known) == (3, 4, False)


def test_other_bytes_are_no_heartbeat() -> None:
    """None, a state that does not exist, and one byte too many."""
    for data in (b"", b"\x42", b"\x05\x05"):
        with pytest.raises(FrameError, match="is no heartbeat"):
            decode_heartbeat(HEARTBEAT_ID + 6, data)


@given(st.floats(), st.floats(), st.one_of(st.none(), st.integers()))
def test_gait_numbers_are_limited_and_never_surer_than_they_were(
    value: float, sigma: float, age_ns: int | None
) -> None:
    """Any number leaves as one of its range, or as none; a sigma is rounded up."""
    event = GAIT_EVENT.decode(
        0x121,
        GAIT_EVENT.encode(GaitEventFrame(1, 0, GaitEventKind.TOUCHDOWN, age_ns, sigma, all_in_air=False)),
    )
    if age_ns is None or not 0 <= age_ns <= 6_553_400_000:
        assert event.age_ns is None or abs(event.age_ns - (age_ns or 0)) <= 50_000
    ground = GROUND.decode(
        0x139, GROUND.encode(Ground(1, 0, (value, 0.0, value), sigma, value, sigma, value))
    )
    for said, true, step, most in (
        (event.sigma_s, sigma, 0.0002, 0.0508),
        (ground.normal_sigma_rad, sigma, 0.0025, 0.315),
        (ground.tangential_over_normal_sigma, sigma, 0.004, 0.248),
    ):
        if not true >= 0.0:
            assert math.isnan(said)
        else:
            assert min(true, most) - 1e-8 <= said < min(true, most) + step
    if value >= 0.0:
        assert ground.tangential_over_normal == pytest.approx(min(value, 2.04), abs=0.0021)
    else:
        assert math.isnan(ground.tangential_over_normal)
