"""The last three readings of every element: in their order, with their times, and nothing from before a gap."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.estimation.network import Readings, ReadingWindow
from footsense.frames import ELEMENTS, Stamps, Vector

SCAN_NS = 25_000_000
STEP_NS = SCAN_NS // ELEMENTS
#: A gap that is no pause of the readings yet, and one that is.
SHORT_NS = SCAN_NS + 3 * SCAN_NS // 4
LONG_NS = SHORT_NS + 1


class Leg:
    """One leg whose readings go into a window."""

    def __init__(self) -> None:
        self._window = ReadingWindow(1, SCAN_NS)
        self.t_ns = np.zeros((1, ELEMENTS), np.int64)
        self.plate_distance_rel = np.full((1, ELEMENTS), np.nan)

    def read(self, plate_distance_rel: Vector | float, t_ns: Stamps | int, *elements: int) -> Readings:
        """Read some elements anew, all without any named, and return the window."""
        read = np.isin(np.arange(ELEMENTS), elements or range(ELEMENTS))
        self.plate_distance_rel = np.where(read, plate_distance_rel, self.plate_distance_rel)
        self.t_ns = np.where(read, t_ns, self.t_ns)
        return self._window.add(self.plate_distance_rel, self.t_ns)

    def scans(self, n: int = 3, start_ns: int = SCAN_NS) -> Readings:
        """Read n whole scans whose distances are their numbers, and return the last window."""
        for number in range(n):
            readings = self.read(number, start_ns + number * SCAN_NS)
        return readings

    def discard(self, *elements: int) -> None:
        self._window.discard_newest(np.isin(np.arange(ELEMENTS), elements)[None])


@pytest.mark.parametrize(("gap_ns", "follows"), [(18_000_000, True), (18_000_001, False)])
def test_a_fast_scan_may_pause_for_18_ms(gap_ns: int, *, follows: bool) -> None:
    """As long as a leg takes that is set up on the same bus: more than two scans of rows."""
    window = ReadingWindow(1, 7_800_000)
    for t_ns in (10_000_000, 17_800_000):
        window.add(np.ones((1, ELEMENTS)), np.full((1, ELEMENTS), t_ns))
    readings = window.add(np.ones((1, ELEMENTS)), np.full((1, ELEMENTS), 17_800_000 + gap_ns))
    assert readings.is_consecutive.all() == follows


def test_a_discarded_reading_is_in_no_later_window() -> None:
    """A wrong reading would be a step of the load twice, there and back."""
    leg = Leg()
    leg.scans()
    leg.read(np.where(np.arange(ELEMENTS) == 4, 99.0, 3.0), 4 * SCAN_NS)
    leg.discard(4)
    # Conversion by conversion it comes again with every frame until its element has been read anew.
    leg.read(3.0, 4 * SCAN_NS + STEP_NS, 5)
    leg.discard(4)
    assert np.flatnonzero(~leg.read(3.0, 5 * SCAN_NS).is_consecutive[0]).tolist() == [4]
    readings = leg.read(3.0, 6 * SCAN_NS)
    assert readings.is_consecutive.all()
    assert readings.plate_distance_rel[:, 0, 4].tolist() == [3.0, 3.0, 3.0]
    assert readings.second_largest_motion_rel == 0.0


def test_motion_is_that_of_the_second_fastest_element() -> None:
    """One element alone is no motion, a pair is; what changed before a pause says nothing."""
    leg = Leg()
    for t_ns in (SCAN_NS, 2 * SCAN_NS):
        leg.read(0.0, t_ns)
    steps = np.zeros(ELEMENTS)
    steps[3] = -5.0
    assert leg.read(steps, 3 * SCAN_NS).second_largest_motion_rel == 0.0
    steps[[3, 7]] += 0.5
    assert leg.read(steps, 4 * SCAN_NS).second_largest_motion_rel == 0.5
    assert leg.read(steps, 5 * SCAN_NS).second_largest_motion_rel == 0.5
    assert leg.read(steps, 6 * SCAN_NS).second_largest_motion_rel == 0.0
    assert leg.read(steps + 1.0, 6 * SCAN_NS + LONG_NS).second_largest_motion_rel == 0.0


@pytest.mark.parametrize("beside", [True, False])
@pytest.mark.parametrize("spike", [0.5, -0.5])
def test_one_wrong_reading_is_replaced_by_those_beside_it(spike: float, *, beside: bool) -> None:
    """From the reading after it on, in every place of the window, and also while another leg is silent."""
    window = ReadingWindow(2, SCAN_NS)
    seen = []
    for n in range(7):
        plate_distance_rel = np.full((2, ELEMENTS), 1.0 - 0.01 * n)
        plate_distance_rel[0, 4] += spike * (n == 3)
        t_ns = np.full((2, ELEMENTS), (n + 1) * SCAN_NS)
        if beside:
            plate_distance_rel[1], t_ns[1] = np.nan, 0
        seen.append(window.add(plate_distance_rel, t_ns).plate_distance_rel[:, 0, 4].copy())
    assert seen[3][0] == pytest.approx(0.97 + spike)
    for n in (4, 5, 6):
        np.testing.assert_allclose(seen[n], 1.0 - 0.01 * (n - np.arange(3)))


def test_a_step_of_the_load_is_no_wrong_reading() -> None:
    """Neither one that stays, nor one of several elements that comes and goes, nor a small one of a single element."""
    for changed, size, n_scans in ([4], 0.5, 9), ([3, 4, 5], 0.5, 1), ([4], 0.09, 1):
        leg = Leg()
        leg.scans()
        for n in range(3):
            plate_distance_rel = np.full(ELEMENTS, 2.0)
            plate_distance_rel[changed] += size * (n < n_scans)
            readings = leg.read(plate_distance_rel, (4 + n) * SCAN_NS)
        expected = 2.0 + size * (np.arange(3) < n_scans)
        np.testing.assert_allclose(readings.plate_distance_rel[::-1, 0, 4], expected)


#: Time since the last frame over a scan, the elements that are read, and whether each gives a number.
frames = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.11, 1.0, 1.5, 3.0, -2.0, 1e9]),
        st.sets(st.integers(0, 8)),
        st.sets(st.integers(0, 8)),
    ),
    max_size=12,
)


@given(frames)
def test_a_window_is_the_last_readings_whatever_comes(
    told: list[tuple[float, set[int], set[int]]],
) -> None:
    """Against lists: an element is whole if its last two readings are numbers and at most 1.5 scans apart."""
    window, t_now_ns = ReadingWindow(1, SCAN_NS), 10 * SCAN_NS
    plate_distance_rel, t_ns = np.full((1, ELEMENTS), np.nan), np.zeros((1, ELEMENTS), np.int64)
    lists: list[list[tuple[float, int]]] = [[(np.nan, 0)] * 3 for _ in range(ELEMENTS)]
    for number, (scans, read, holed) in enumerate(told):
        t_now_ns += round(scans * SCAN_NS)
        for element in read:
            value = np.nan if element in holed else float(number + element)
            plate_distance_rel[0, element] = value
            if t_ns[0, element] == t_now_ns:
                lists[element][-1] = (value, t_now_ns)
            else:
                t_ns[0, element] = t_now_ns
                lists[element].append((value, t_now_ns))
        readings = window.add(plate_distance_rel, t_ns)
        for element, kept in enumerate(lists):
            (third, third_ns), (second, second_ns), (first, first_ns) = kept[-3:]
            follows = [
                0 < later - earlier <= SHORT_NS and bool(np.isfinite(value - before))
                for later, earlier, value, before in (
                    (first_ns, second_ns, first, second),
                    (second_ns, third_ns, second, third),
                )
            ]
            assert readings.is_consecutive[0, element] == follows[0]
            if not follows[1]:
                third, third_ns = second, 2 * second_ns - first_ns
            if follows[0]:
                assert readings.plate_distance_rel[:, 0, element].tolist() == [first, second, third]
                assert readings.t_ns[:, 0, element].tolist() == [first_ns, second_ns, third_ns]
        assert np.isfinite(readings.second_largest_motion_rel).all()
        assert (readings.second_largest_motion_rel >= 0.0).all()
