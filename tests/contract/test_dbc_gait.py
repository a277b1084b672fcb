"""Gait frames: the DBC and the Python codecs are two accounts of the same frames."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.can.codes import (
    NODE_IDS,
    GaitEventKind,
    Slip,
)
from firmware_interface.can.gait import (
    GAIT_EVENT_ID,
    GAIT_ID,
    GROUND_ID,
    decode_gait,
    decode_gait_event,
    decode_ground,
    encode_gait,
    encode_gait_event,
    encode_ground,
)
from tests.contract.dbc import (
    counters,
    decode,
    encode,
    legs,
    number,
)


@given(
    legs,
    counters,
    st.sampled_from(GaitEventKind),
    st.one_of(st.none(), st.integers(0, 65534)),
    st.one_of(st.none(), st.integers(0, 254)),
    st.booleans(),
)
def test_gait_event(
    leg: str,
    counter: int,
    kind: GaitEventKind,
    age: int | None,
    sigma: int | None,
    air: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    """Each reads what the other writes."""
    name, node = f"GaitEvent{leg.capitalize()}", NODE_IDS[leg]
    age_ns = None if age is None else age * 100_000
    data = encode_gait_event(node, counter, kind, age_ns, number(sigma, 5000), all_in_air=air)
    signals = decode(name, data)
    assert signals == pytest.approx(
        {
            "CHECKSUM": data[0],
            "COUNTER": counter,
            "Kind": kind,
            "Age": 6553.5 if age is None else age / 10,
            "Sigma": 51.0 if sigma is None else sigma / 5,
            "AllInAir": int(air),
        }
    )
    theirs = encode(name, signals)
    assert theirs == data
    ours = decode_gait_event(GAIT_EVENT_ID + node, theirs)
    assert ours == pytest.approx((node, counter, kind, age_ns, number(sigma, 5000), air), nan_ok=True)


shares = st.one_of(st.none(), st.integers(0, 200))


@given(legs, counters, st.sampled_from(Slip), st.tuples(*[st.booleans()] * 3), shares, shares)
def test_gait(
    leg: str,
    counter: int,
    slip: Slip,
    states: tuple[bool, bool, bool],
    probability: int | None,
    share: int | None,
) -> None:
    """Each reads what the other writes."""
    name, node = f"Gait{leg.capitalize()}", NODE_IDS[leg]
    contact, raw, air = states
    values = number(probability, 200), number(share, 200)
    data = encode_gait(node, counter, slip, *values, contact=contact, contact_raw=raw, all_in_air=air)
    signals = decode(name, data)
    assert signals == pytest.approx(
        {
            "CHECKSUM": data[0],
            "COUNTER": counter,
            "Contact": int(contact),
            "ContactRaw": int(raw),
            "AllInAir": int(air),
            "Slip": slip,
            "Probability": 1.275 if probability is None else probability / 200,
            "LoadShare": 1.275 if share is None else share / 200,
        }
    )
    theirs = encode(name, signals)
    assert theirs == data
    ours = decode_gait(GAIT_ID + node, theirs)
    assert ours == pytest.approx((node, counter, contact, raw, air, slip, *values), nan_ok=True)


@given(
    legs,
    counters,
    st.one_of(st.none(), st.tuples(st.integers(-350, 350), st.integers(-350, 350))),
    st.one_of(st.none(), st.integers(0, 126)),
    st.one_of(st.none(), st.integers(0, 510)),
    st.one_of(st.none(), st.integers(0, 62)),
    st.one_of(st.none(), st.integers(0, 510)),
)
def test_ground(
    leg: str,
    counter: int,
    normal: tuple[int, int] | None,
    sigma: int | None,
    use: int | None,
    use_sigma: int | None,
    friction: int | None,
) -> None:
    """Each reads what the other writes."""
    name, node = f"Ground{leg.capitalize()}", NODE_IDS[leg]
    x, y = (math.nan, math.nan) if normal is None else (normal[0] / 500, normal[1] / 500)
    unit = x, y, math.sqrt(1.0 - x * x - y * y)
    values = number(sigma, 400), number(use, 250), number(use_sigma, 250), number(friction, 250)
    data = encode_ground(node, counter, unit, *values)
    signals = decode(name, data)
    assert signals == pytest.approx(
        {
            "CHECKSUM": data[0],
            "COUNTER": counter,
            "NormalX": -1.024 if normal is None else x,
            "NormalY": -1.024 if normal is None else y,
            "NormalSigma": 0.3175 if sigma is None else sigma / 400,
            "TangentialOverNormal": 2.044 if use is None else use / 250,
            "TangentialOverNormalSigma": 0.252 if use_sigma is None else use_sigma / 250,
            "Friction": 2.044 if friction is None else friction / 250,
        }
    )
    theirs = encode(name, signals)
    assert theirs == data
    ours = decode_ground(GROUND_ID + node, theirs)
    assert ours.normal == pytest.approx(unit, nan_ok=True)
    assert ours[3:] == pytest.approx(values, nan_ok=True)
