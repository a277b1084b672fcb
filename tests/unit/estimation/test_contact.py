"""One leg's contact: what a glitch, a silence or a drift may not do, and which commands it forbids."""

import math
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.estimation.noise import SwingNoise
from footsense.estimation.walking.contact import ContactDetector
from footsense.frames import CommandKind, Vector

MS = 1_000_000


class Leg:
    """A leg whose load is given, read every 25 ms."""

    def __init__(self) -> None:
        self.contact = ContactDetector(0.03, 0.5e-3)
        self.t_ns = 1_000 * MS
        self.contact.reset(self.t_ns)

    def carry(self, load_n: float, n_frames: int = 1, drift_n: float = 0.0, each_ns: int = 25 * MS) -> bool:
        """Return whether the foot is in contact after these frames; it has to be the same after each of them."""
        in_contact = set()
        for _ in range(n_frames):
            self.t_ns += each_ns
            self.contact.observe(load_n, drift_n, self.t_ns, self.t_ns)
            in_contact.add(self.contact.in_contact)
        [same] = in_contact
        return same

    def predict(
        self, predicted_n: float, load_n: float = 0.0, after_ms: float = 2.7, sigma_n: float = math.nan
    ) -> bool:
        """Read one element more, of which a prediction makes a load before the others show it."""
        self.t_ns += round(after_ms * MS)
        self.contact.observe(load_n, 0.0, self.t_ns, self.t_ns, predicted_n, sigma_n)
        return self.contact.in_contact


def test_touch_and_lift_do_not_chatter() -> None:
    """Contact from threshold_n, held down to its half; confirmed swing only a while after."""
    leg = Leg()
    assert not leg.carry(0.029)
    assert leg.carry(0.031)
    assert leg.carry(0.016, 100)
    assert not leg.carry(0.014)
    assert not leg.carry(0.029, 2)
    assert not leg.contact.in_swing
    leg.carry(0.0, 4)
    assert not leg.contact.in_swing
    leg.carry(0.0, 4)
    assert leg.contact.in_swing


def test_a_light_stance_is_contact_for_ever_and_a_fallen_load_is_not() -> None:
    """What drift could explain ends a contact only if much more was carried just before."""
    standing, lifted = Leg(), Leg()
    assert standing.carry(0.06, 4000, drift_n=0.1)
    lifted.carry(1.0, 100, drift_n=0.1)
    assert not lifted.carry(0.06, drift_n=0.1)
    leaning = Leg()
    leaning.carry(1.0, 100)
    assert leaning.carry(0.4, 4000)


def test_creep_follows_the_load_of_the_last_minutes() -> None:
    """A twentieth of a mean over 100 s, read once a second: 1 N for 100 s, then a load below nothing for as long."""
    leg = Leg()
    leg.carry(1.0, 101, each_ns=1000 * MS)
    stood_n = 1 - (100 / 101) ** 100
    assert leg.contact.drift_n == pytest.approx(0.05 * stood_n)
    leg.carry(-0.5, 101, drift_n=0.02, each_ns=1000 * MS)
    after_n = (stood_n + (1 - stood_n) / 101) * (100 / 101) ** 100
    assert leg.contact.drift_n == pytest.approx(0.02 + 0.05 * after_n)


def test_a_glitch_downwards_makes_no_contact() -> None:
    """One reading of -0.3 N does not lower the floor; a second of it does, and the next step heals that."""
    leg = Leg()
    leg.carry(0.0, 20)
    leg.carry(-0.3)
    assert not leg.carry(0.0, 20)
    leg.carry(-0.3, 40)
    assert leg.carry(0.0)
    leg.carry(1.0, 20)
    assert not leg.carry(0.0)
    assert not leg.carry(0.0, 20)


def test_how_many_readings_a_glitch_has_does_not_matter() -> None:
    """Forty within 40 ms do not lower the floor; what lasts for 110 ms does."""
    for n_frames, lowers in ((40, False), (110, True)):
        leg = Leg()
        leg.carry(0.0, 200, each_ns=MS)
        leg.carry(-0.3, n_frames, each_ns=MS)
        assert leg.carry(0.0, each_ns=MS) is lowers


def test_a_glitch_right_after_a_lift_off_makes_no_contact() -> None:
    """How low the load was before the stance says nothing of the swing after it."""
    leg = Leg()
    leg.carry(-0.02, 20)
    leg.carry(1.0, 20)
    assert not leg.carry(-0.005, drift_n=0.01)
    assert not leg.carry(-0.3)
    assert not leg.carry(0.02, 20)


def test_a_lift_off_that_swings_below_nothing_is_followed_by_no_contact() -> None:
    """The reading after one below nothing lies far above it, and is nothing all the same."""
    leg = Leg()
    leg.carry(1.0, 20)
    assert not leg.carry(-0.036)
    assert not leg.carry(0.0, 20)
    assert leg.carry(0.3)


def test_a_touch_is_predicted_and_held_until_all_have_been_read() -> None:
    """The first element of a touchdown makes contact; if the others do not follow within a scan, it was none."""
    leg = Leg()
    leg.carry(0.0, 20)
    assert not leg.predict(0.029)
    assert leg.predict(0.05)
    assert all(leg.predict(0.2, load_n=0.02 * n) for n in range(9))
    assert leg.predict(0.3, load_n=0.3)
    other = Leg()
    other.carry(0.0, 20)
    assert other.predict(0.05)
    assert not other.predict(0.0, after_ms=31.0)


def test_a_prediction_of_a_fast_scan_needs_more_sigmas() -> None:
    """A foot that slows down before it touches is pulled by its own mass, and a fast scan predicts a load from that."""
    usual, fast = Leg(), Leg()
    fast.contact = ContactDetector(0.03, 0.5e-3, prediction_sigmas=2.0)
    fast.contact.reset(fast.t_ns)
    usual.carry(0.0, 10)
    fast.carry(0.0, 10)
    assert usual.predict(0.15, sigma_n=0.1)
    assert not fast.predict(0.15, sigma_n=0.1)
    assert fast.predict(0.25, sigma_n=0.1)
    assert fast.contact.predicted_touch_n == 0.2


def test_a_load_that_sigma_does_not_allow_is_no_contact_and_not_learnt() -> None:
    """A line that breaks in swing: half a newton, measured and predicted, with a sigma of twice as much."""
    leg = Leg()
    leg.carry(0.0, 20)
    for _ in range(40):
        assert not leg.predict(0.5, load_n=0.5, sigma_n=1.0)
        leg.carry(0.0, 2)
    assert leg.carry(0.04)
    assert leg.predict(0.05, sigma_n=0.04)
    assert leg.predict(0.5, load_n=0.5, sigma_n=1.0), "a contact does not end as its force gets uncertain"


def test_a_prediction_that_rings_after_lift_off_predicts_nothing() -> None:
    """For a tenth of a second; a touch that is measured counts all the same."""
    leg = Leg()
    leg.carry(1.0, 20)
    assert not leg.carry(0.0)
    assert not any(leg.predict(0.3, after_ms=9.0) for _ in range(11))
    assert leg.predict(0.3, after_ms=9.0)
    other = Leg()
    other.carry(1.0, 20)
    assert not other.carry(0.0)
    assert other.predict(0.1, load_n=0.3)


def test_shake_of_a_foot_that_carries_ten_times_as_much_is_no_contact() -> None:
    """From the first swing on; once swings are known to be quiet, a light touch is contact at once."""
    shaking, quiet = Leg(), Leg()
    for leg, shake_n in ((shaking, 0.1), (quiet, 0.0)):
        for swing in range(8):
            leg.carry(1.0, 20)
            leg.carry(0.0, 3)
            assert not any(leg.carry(shake_n * math.sin(n), each_ns=8 * MS) for n in range(30)), swing
    assert quiet.carry(0.05)
    assert not shaking.carry(0.05)
    assert shaking.carry(0.3)


def test_shake_that_makes_contact_is_learnt() -> None:
    """A tenth of what the foot carries, for 20 ms of each swing, after a rest: in contact in the first swings alone."""
    leg = Leg()
    leg.carry(0.0, 500, each_ns=2 * MS)
    contacts = []
    for _ in range(20):
        leg.carry(0.0, 50, each_ns=2 * MS)
        for _ in range(10):
            leg.predict(0.1, 0.1, 2)
        contacts.append(leg.contact.in_contact)
        for _ in range(30):
            leg.predict(0.0, 0.0, 2)
        assert not leg.contact.in_contact
        leg.predict(1.0, 1.0, 2)
        assert leg.carry(1.0, 100, each_ns=2 * MS)
        for _ in range(30):
            leg.predict(0.0, 0.0, 2)
    assert not any(contacts[3:])


def test_a_bounce_is_no_lift_off() -> None:
    """The load after an impact may be gone for 20 ms; after 100 ms of stance it may not."""
    leg = Leg()
    leg.carry(0.0, 50, each_ns=2 * MS)
    assert leg.carry(1.0, 10, each_ns=2 * MS)
    assert leg.carry(0.0, 10, each_ns=2 * MS)
    assert leg.carry(0.3, 50, each_ns=2 * MS)
    assert leg.carry(0.0, 6, each_ns=2 * MS)
    assert not leg.carry(0.0, 4, each_ns=2 * MS)


def test_silence_is_not_contact() -> None:
    """Believed for a quarter of a second without a reading, unknown then; found again at the first reading."""
    leg = Leg()
    leg.carry(0.5, 4)
    assert leg.carry(math.nan, 10)
    assert not leg.carry(math.nan)
    assert not leg.contact.in_swing
    assert not leg.contact.explained_by_drift
    assert leg.carry(0.5)


@given(st.lists(st.tuples(st.floats(-2, 2) | st.just(math.nan), st.integers(-50, 500)), max_size=60))
def test_whatever_is_read_a_touch_is_seen_at_once_and_no_touch_is_invented(
    readings: list[tuple[float, int]],
) -> None:
    """Below the threshold after rest there is no contact; a newton on top of rest is; both after any history."""
    leg = Leg()
    for load_n, passed_ms in readings:
        leg.t_ns += passed_ms * MS
        leg.carry(load_n)
        assert not (leg.contact.in_contact and leg.contact.in_swing)
    leg.carry(1.0, 200)
    leg.carry(0.0, 40)
    assert not leg.contact.in_contact
    assert leg.contact.in_swing
    assert leg.carry(1.0)


@pytest.mark.parametrize(
    ("kind", "in_contact", "load_n", "drift_n", "says"),
    [
        (CommandKind.START, True, 1.0, 0.0, None),
        (CommandKind.STOP, False, 0.0, 0.0, None),
        (CommandKind.STOP, False, math.nan, 0.0, None),
        (CommandKind.STOP, True, 0.41, 0.5, "carries 0.41 N"),
        (CommandKind.STOP, True, math.nan, 0.0, "not known now"),
        (CommandKind.TARE, False, 0.02, 0.0, None),
        (CommandKind.TARE, False, math.nan, 0.0, None),
        (CommandKind.TARE, True, 0.41, 0.05, "carries 0.41 N, and drift explains at most 0.05 N"),
        (CommandKind.TARE, True, 0.04, 0.05, None),
        (CommandKind.TARE, True, math.nan, 0.05, "not known now"),
    ],
)
def test_commands_only_where_they_are_safe(
    kind: CommandKind, *, in_contact: bool, load_n: float, drift_n: float, says: str | None
) -> None:
    """On the ground no STOP and no TARE, unless drift explains the whole load; START and unknown contact always."""
    contact = ContactDetector(0.03, 0.5e-3)
    contact.in_contact, contact.drift_n = in_contact, drift_n
    contact.load_n = contact.carried_n = load_n
    reason = contact.refusal(kind)
    assert reason is None if says is None else reason is not None and says in reason


STEP_S = 2.7167e-3
LEAST_N = 0.0045


class Signal:
    """A signal of one leg in swing, conversion by conversion."""

    def __init__(self) -> None:
        self.noise = SwingNoise(LEAST_N)
        self.t_s = 1.0
        self.noise.discard_pending(round(self.t_s * 1e9))

    def feed(self, values_n: Iterable[float]) -> float:
        """Observe values [N], and return the threshold [N]."""
        for value_n in values_n:
            self.t_s += STEP_S
            if value_n <= self.touch_n():
                self.noise.block_n.append(value_n)
            if self.t_s * 1e9 >= self.noise.end_ns:
                self.noise.end_block(round(self.t_s * 1e9), self.touch_n())
        return self.touch_n()

    def touch_n(self) -> float:
        """Return the threshold of a foot that carried 1 N in its stance [N]."""
        return max(LEAST_N, min(0.25, self.noise.contact_n))


def times_s(duration_s: float) -> Vector:
    return np.arange(0.0, duration_s, STEP_S)


@given(st.integers(0, 1000), st.floats(0.5e-3, 5e-3))
def test_noise_stays_below_its_threshold(seed: int, sigma_n: float) -> None:
    """Ten seconds of noise about the floor, then ten more: above the threshold at most once in a thousand readings."""
    rng = np.random.default_rng(seed)
    signal = Signal()
    threshold_n = signal.feed(sigma_n * rng.normal(size=3700))
    assert threshold_n < max(9.0 * sigma_n, LEAST_N)
    assert np.mean(sigma_n * rng.normal(size=3700) > threshold_n) < 1e-3


@pytest.mark.parametrize("hertz", [3.0, 8.0, 20.0])
def test_shake_raises_the_threshold_above_its_peaks(hertz: float) -> None:
    """It passes and comes back, whatever its frequency."""
    shake_n = 0.02 * np.sin(2.0 * math.pi * hertz * times_s(3.0))
    assert 0.02 < Signal().feed(shake_n) < 0.06


@given(n_per_s=st.floats(2e-3, 0.5), noisy=st.booleans())
def test_a_load_that_comes_slowly_is_not_noise(*, n_per_s: float, noisy: bool) -> None:
    """A foot that is put down gently crosses the threshold: that does not run away from it."""
    signal = Signal()
    rng = np.random.default_rng(1)
    signal.feed(1e-3 * rng.normal(size=400) * noisy)
    rise_n = n_per_s * times_s(min(2.0 * 0.03 / n_per_s, 30.0))
    for value_n in rise_n + 1e-3 * rng.normal(size=len(rise_n)) * noisy:
        if value_n > signal.feed([value_n]):
            return
    raise AssertionError(f"{rise_n[-1]} N are below the threshold of {signal.touch_n()} N")


def test_a_bias_of_the_signal_is_part_of_its_noise() -> None:
    """A prediction that reads a little too much in the air has a threshold above that."""
    noise_n = 1.5e-3 * np.random.default_rng(2).normal(size=2000)
    assert Signal().feed(1e-3 + noise_n) == pytest.approx(Signal().feed(noise_n) + 1e-3, rel=0.05)


def test_the_rise_of_a_touchdown_is_not_learnt() -> None:
    """The last blocks before it are dropped."""
    signal = Signal()
    signal.feed(np.zeros(400))
    signal.feed([0.0, 0.02, 0.1, 0.3, 0.6, 1.0])
    signal.noise.discard_pending(round(signal.t_s * 1e9))
    assert signal.feed(np.zeros(100)) == LEAST_N
