"""Feet with more than nine elements on CAN: the codecs, the DBC and both clients agree, up to eight legs."""

import ctypes
import json
import math
from typing import Any

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.can.all_legs import FORCES4_ID, NODES_OF_FRAME, decode_forces, encode_forces
from firmware_interface.can.codes import NODE_IDS, State
from firmware_interface.can.dbc import make_dbc
from firmware_interface.can.force import (
    FORCE_ID,
    QUALITY_ID,
    ForceQualityEncoder,
    decode_force,
    decode_quality,
)
from firmware_interface.can.socketcan import split_frames
from footsense.client import Link, LinkLimits
from tests.contract import link_vectors
from tests.contract.c_decoder import CLink, in_c_units, library

FRAMES = json.loads(link_vectors.PATH.with_name("can_frames.json").read_text())
DBC = cantools.database.load_string(make_dbc(list(NODE_IDS), n_elements=16), "dbc")
LIMITS = LinkLimits(min_good=1)

sigmas = st.one_of(st.just(math.nan), st.floats(0.0, 2.0))

Axes = tuple[float, float, float]
#: Nodes of the legs, and what the encoders take of them.
Robot = tuple[list[int], list[int], list[State], list[Axes], list[Axes], list[int], list[int]]


@st.composite
def robots(draw: st.DrawFn) -> Robot:
    """Return nodes of one to eight legs, and what the encoders take of them."""
    nodes = sorted(draw(st.sets(st.integers(1, 8), min_size=1)))
    n = len(nodes)
    masks = draw(st.lists(st.integers(0, 0xFFFF), min_size=n, max_size=n))
    sigma_n = draw(st.lists(st.tuples(sigmas, sigmas, sigmas), min_size=n, max_size=n))
    return nodes, [1] * n, [State.VALID] * n, [(0.1, -0.2, 1.0)] * n, sigma_n, [0] * n, masks


def is_bound(told_n: float, sigma_n: float, step_n: float, most_n: float) -> bool:
    """Return whether a told standard deviation is the true one, rounded up and cut off."""
    if math.isnan(sigma_n):
        return math.isnan(told_n)
    return min(sigma_n, most_n) - 1e-6 <= told_n <= min(sigma_n + step_n, most_n + 1e-9)


@given(robots(), st.integers(0, 14))
def test_every_reader_has_what_was_sent(robot: Robot, counter: int) -> None:
    """Masks whole, sigmas never smaller than they are: codec, DBC, and the clients in Python and C."""
    nodes, legs = robot[0], robot[1:]
    sigma_n, masks = legs[3], legs[5]
    single = list(split_frames(ForceQualityEncoder(nodes, 16).encode(counter, 1_000_001, *legs)))
    fd = [
        (can_id, encode_forces(can_id, counter, 1_000_001, nodes, *legs, n_elements=16))
        for can_id in NODES_OF_FRAME
    ]
    for frames, most_n, step_n in ((single, 0.992, 0.016), (fd, 0.96, 0.032)):
        ours, theirs = Link(LIMITS, n_elements=16), CLink(LIMITS, 16)
        for can_id, data in frames:
            assert ours.feed(can_id, data, 0) == theirs.feed(can_id, data, 0)
        for node, mask, (x_n, y_n, z_n) in zip(nodes, masks, sigma_n, strict=True):
            view = ours.leg(node, 0)
            assert theirs.look(node, 0) == in_c_units(view)
            assert (view.usable, view.fault_mask) == (True, mask)
            widest_n = x_n + y_n if math.isnan(x_n + y_n) else max(x_n, y_n)
            sent_n = (x_n, y_n, z_n) if frames is single else (widest_n, widest_n, z_n)
            assert all(map(is_bound, view.sigma_n, sent_n, [step_n] * 3, [most_n] * 3))
    for can_id, data in single:
        if can_id - QUALITY_ID in nodes:
            told = DBC.decode_message(can_id, data, decode_choices=False)
            quality = decode_quality(can_id, data, 16)
            assert told["FaultMask"] == quality.fault_mask
            assert_equal([told[f"Sigma{axis}"] for axis in "XYZ"], quality.sigma_n, 63 * 0.016)
    for can_id, data in fd:
        told = DBC.decode_message(can_id, data, decode_choices=False)
        for (force, quality), leg in zip(decode_forces(can_id, data, 16).legs, names(can_id), strict=True):
            assert (told[f"State{leg}"], told[f"FaultMask{leg}"]) == (force.state, quality.fault_mask)
            both = [told[f"SigmaXY{leg}"], told[f"SigmaZ{leg}"]]
            assert_equal(both, quality.sigma_n[1:], 31 * 0.032)


def names(can_id: int) -> list[str]:
    """Return the legs of a CAN FD frame as the DBC says them."""
    return [leg.capitalize() for leg, node in NODE_IDS.items() if node in NODES_OF_FRAME[can_id]]


def assert_equal(told_n: list[float], sigma_n: tuple[float, ...], none_n: float) -> None:
    """The DBC has a number where the codec has none."""
    expected = [none_n if math.isnan(one) else one for one in sigma_n]
    assert told_n == pytest.approx(expected)


class _CQuality(ctypes.Structure):
    _fields_ = (
        ("node", ctypes.c_uint8),
        ("counter", ctypes.c_uint8),
        ("flags", ctypes.c_uint8),
        ("fault_mask", ctypes.c_uint16),
        ("sigma_mn", ctypes.c_uint16 * 3),
        ("age_us", ctypes.c_uint32),
    )


@pytest.mark.parametrize("vector", FRAMES["quality_of_16_elements"], ids=lambda vector: vector["data"])
def test_both_read_the_vectors_of_quality(vector: dict[str, Any]) -> None:
    """Numbers and bytes are written down, for a decoder in any language."""
    can_id, data = QUALITY_ID + vector["node"], bytes.fromhex(vector["data"])
    quality, out = decode_quality(can_id, data, 16), _CQuality()
    sigma_n = [math.nan if one is None else one for one in vector["sigma_n"]]
    assert quality[1:5] == (vector["counter"], vector["flags"], vector["age_ns"], vector["fault_mask"])
    assert quality.sigma_n == pytest.approx(sigma_n, nan_ok=True)
    assert library().footsense_decode_quality_of(16, can_id, data, len(data), ctypes.byref(out))
    assert out.fault_mask == vector["fault_mask"]
    assert list(out.sigma_mn) == [0xFFFF if math.isnan(one) else round(one * 1000) for one in sigma_n]


def test_both_read_the_vector_of_forces() -> None:
    """The frame of nodes 7 and 8; the first of them has a force."""
    (vector,) = FRAMES["forces4_of_16_elements"]
    data = bytes.fromhex(vector["data"])
    first, second = (quality for _, quality in decode_forces(FORCES4_ID, data, 16).legs)
    assert [first.fault_mask, second.fault_mask] == vector["fault_mask"]
    assert first.sigma_n == tuple(vector["sigma_n"][0])
    assert all(map(math.isnan, second.sigma_n))
    link = CLink(LIMITS, 16)
    link.feed(FORCES4_ID, data, 0)
    assert link.look(7, 0)[4:7] == (vector["fault_mask"][0], (100, -200, 1000), (32, 32, 960))


@pytest.mark.parametrize("n_elements", [4, 9])
def test_up_to_nine_elements_have_one_layout(n_elements: int) -> None:
    """A foot with fewer elements sends what one with nine does."""
    legs = [1], [State.VALID], [(0.1, 0.2, 0.3)], [(0.01, 0.02, 0.03)], [0], [5]
    frames = ForceQualityEncoder([1], n_elements).encode(3, 1, *legs)
    assert frames == ForceQualityEncoder([1]).encode(3, 1, *legs)
    assert make_dbc(["lf"], n_elements=9) == make_dbc(["lf"])


def test_more_elements_than_the_mask_has_bits_are_one_line() -> None:
    """Wherever they are told first; the force itself does not depend on them."""
    for make in (ForceQualityEncoder, lambda _, n: make_dbc(["lf"], 1, n), lambda _, n: Link(n_elements=n)):
        with pytest.raises(ValueError, match=r"^25 elements: the frames hold the masks of 1 to 16$"):
            make([1], 25)
    sent = dict(
        split_frames(ForceQualityEncoder([1], 16).encode(0, 1, [1], [1], [(1, 1, 1)], [(0, 0, 0)], [0], [0]))
    )
    assert decode_force(FORCE_ID + 1, sent[FORCE_ID + 1]).force_n == (1.0, 1.0, 1.0)
