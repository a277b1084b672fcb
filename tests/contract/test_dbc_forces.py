"""Forces, quality, faults and baselines: the DBC and the Python codecs are two accounts of the same frames."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.can.all_legs import (
    FORCES4_ID,
    FORCES_ID,
    NODES_OF_FRAME,
    decode_forces,
    encode_forces,
)
from firmware_interface.can.codes import (
    NODE_IDS,
    USABLE,
    BaselineStatus,
    Cause,
    Flag,
    State,
)
from firmware_interface.can.force import (
    FORCE_ID,
    QUALITY_ID,
    decode_force,
    decode_quality,
)
from firmware_interface.can.reports import (
    BASELINE_ID,
    FAULT_ID,
    decode_baseline,
    decode_fault,
    encode_baseline,
    encode_fault,
)
from tests.contract.dbc import (
    DBC,
    LEGS,
    counters,
    decode,
    encode,
    legs,
    masks,
    millinewtons,
    offsets,
    sigma_codes,
)
from tests.support.can_frames import encode_force, encode_quality


@st.composite
def robots(draw: st.DrawFn) -> tuple[list[int], list[Any]]:
    """Return the nodes of some legs, and for each state, force, sigma, flags and mask."""
    nodes = draw(st.lists(st.integers(1, 8), min_size=1, max_size=8, unique=True))
    common = draw(st.sampled_from([0, 1, 2, 3]))
    parts = [
        (
            draw(st.sampled_from(State)),
            tuple(draw(st.integers(-32767, 32767)) / 1000 for _ in range(3)),
            tuple(draw(st.integers(0, 254)) / 250 for _ in range(3)),
            draw(st.sampled_from([0, 4, 8, 12])) | common,
            draw(masks),
        )
        for _ in nodes
    ]
    return nodes, parts


@given(st.sampled_from([FORCES_ID, FORCES4_ID]), robots(), counters, st.integers(0, 254))
def test_forces_of_all_legs(can_id: int, robot: tuple[list[int], list[Any]], counter: int, age: int) -> None:
    """cantools, Python and the single frames agree on what one CAN FD frame says of every leg."""
    nodes, parts = robot
    state, force_n, sigma_n, flags, mask = zip(*parts, strict=True)
    t_ns, t_sent_ns = [1] * len(nodes), 1 + age * 500_000
    data = encode_forces(can_id, counter, t_sent_ns, nodes, t_ns, state, force_n, sigma_n, flags, mask)
    name = "Forces" if can_id == FORCES_ID else "Forces4"
    signals = decode(name, data)
    ours = decode_forces(can_id, data)
    assert (signals["CHECKSUM"], signals["COUNTER"]) == (int.from_bytes(data[:2], "little"), counter)
    assert signals["AllInAir"] == ours.all_in_air
    usable = [code in USABLE for code in state]
    assert ours.all_in_air == (all(usable) and not any(flag & Flag.CONTACT for flag in flags))
    shown = [code for node, code in zip(nodes, usable, strict=True) if node in NODES_OF_FRAME[can_id]]
    assert signals["Age"] == (age / 2 if any(shown) else 127.5)
    of_frame = [LEGS[node - 1] for node in NODES_OF_FRAME[can_id]]
    for leg, (force, quality) in zip(of_frame, ours.legs, strict=True):
        read = [signals[f"Force{axis}{leg}"] for axis in "XYZ"]
        assert read == pytest.approx([-32.768 if math.isnan(f) else f for f in force.force_n])
        assert (signals[f"State{leg}"], signals[f"FaultMask{leg}"]) == (force.state, quality.fault_mask)
        assert signals[f"Contact{leg}"] == bool(quality.flags & Flag.CONTACT)
        assert signals[f"TareRefused{leg}"] == bool(quality.flags & Flag.TARE_REFUSED)
        sigmas = [signals[f"SigmaXY{leg}"]] * 2 + [signals[f"SigmaZ{leg}"]]
        assert sigmas == pytest.approx([1.02 if math.isnan(s) else s for s in quality.sigma_n])
        if NODE_IDS[leg.lower()] not in nodes:
            assert (force.state, quality.fault_mask, quality.age_ns) == (State.ABSENT, 0, None)
            continue
        row = nodes.index(NODE_IDS[leg.lower()])
        assert (force.counter, force.state, quality.flags) == (counter, state[row], flags[row])
        assert quality.fault_mask == mask[row]
        x_n, y_n, z_n = sigma_n[row]
        assert quality.sigma_n == pytest.approx((max(x_n, y_n), max(x_n, y_n), z_n))
        if usable[row]:
            assert (force.force_n, quality.age_ns) == (force_n[row], age * 500_000)
        else:
            assert all(map(math.isnan, force.force_n))
            assert quality.age_ns is None
    message = DBC.get_message_by_name(name)
    assert message.encode(signals, strict=False) == data


@given(legs, counters, st.sampled_from(State), st.tuples(millinewtons, millinewtons, millinewtons))
def test_force(
    leg: str, counter: int, state: State, force_mn: tuple[int | None, int | None, int | None]
) -> None:
    """Each reads what the other writes."""
    name, node = f"Force{leg.capitalize()}", NODE_IDS[leg]
    force_n = tuple(math.nan if mn is None else mn / 1000 for mn in force_mn)
    data = encode_force(node, counter, state, force_n)
    signals = decode(name, data)
    ours = decode_force(FORCE_ID + node, data)
    assert (signals["CHECKSUM"], signals["COUNTER"], signals["State"]) == (data[0], counter, ours.state)
    read = [signals["ForceX"], signals["ForceY"], signals["ForceZ"]]
    assert read == pytest.approx([-32.768 if math.isnan(f) else f for f in ours.force_n])
    theirs = encode(name, signals)
    assert theirs == data


@given(legs, counters, st.integers(0, 15), st.one_of(st.none(), st.integers(0, 4094)), masks, sigma_codes)
def test_quality(leg: str, counter: int, flags: int, age: int | None, mask: int, sigma: int | None) -> None:
    """Each reads what the other writes."""
    name, node = f"Quality{leg.capitalize()}", NODE_IDS[leg]
    sigma_n = (math.nan if sigma is None else sigma / 500, 0.0, 0.02)
    data = encode_quality(node, counter, flags, None if age is None else age * 100_000, mask, sigma_n)
    signals = decode(name, data)
    assert signals == pytest.approx(
        {
            "CHECKSUM": data[0],
            "COUNTER": counter,
            "Simulated": flags & 1,
            "DegradedTiming": flags >> 1 & 1,
            "TareRefused": flags >> 2 & 1,
            "Contact": flags >> 3 & 1,
            "Age": 409.5 if age is None else age / 10,
            "FaultMask": mask,
            "SigmaX": 1.022 if sigma is None else sigma / 500,
            "SigmaY": 0.0,
            "SigmaZ": 0.02,
        }
    )
    theirs = encode(name, signals)
    assert decode_quality(QUALITY_ID + node, theirs)[:5] == decode_quality(QUALITY_ID + node, data)[:5]
    assert theirs == data


def test_codes_for_no_value_are_named() -> None:
    """A tool that shows value tables shows `NoValue`, not a number."""
    force = DBC.decode_message("ForceLf", encode_force(1, 0, State.STALE, (1.0, 1.0, 1.0)))
    assert [str(force[f"Force{axis}"]) for axis in "XYZ"] == ["NoValue"] * 3
    quality = DBC.decode_message("QualityLf", encode_quality(1, 0, 0, None, 0, (math.nan, 2.0, math.nan)))
    assert [str(quality[s]) for s in ("Age", "SigmaX", "SigmaY")] == ["NoValue", "NoValue", "Saturated"]


@given(legs, counters, st.sampled_from(State), st.sampled_from(State), masks, st.sampled_from(Cause))
def test_fault(leg: str, counter: int, state: State, previous: State, mask: int, cause: Cause) -> None:
    """Each reads what the other writes."""
    node = NODE_IDS[leg]
    signals = {
        "COUNTER": counter,
        "State": state,
        "PreviousState": previous,
        "FaultMask": mask,
        "Cause": cause,
    }
    theirs = encode(f"Fault{leg.capitalize()}", signals)
    assert decode_fault(FAULT_ID + node, theirs) == (node, counter, state, previous, mask, cause)
    assert theirs == encode_fault(node, counter, state, previous, mask, cause)


@given(
    legs,
    counters,
    st.sampled_from(BaselineStatus),
    offsets,
    offsets,
    st.one_of(st.none(), st.integers(0, 65534)),
)
def test_baseline(
    leg: str, counter: int, status: BaselineStatus, mean: int | None, worst: int | None, age: int | None
) -> None:
    """Each reads what the other writes, in fF and s here and in pF and ns there."""
    name, node = f"Baseline{leg.capitalize()}", NODE_IDS[leg]
    mean_pf, worst_pf = (math.nan if code is None else code / 10_000 for code in (mean, worst))
    age_ns = None if age is None else age * 100_000_000
    data = encode_baseline(node, counter, status, mean_pf, worst_pf, age_ns)
    signals = decode(name, data)
    assert signals == pytest.approx(
        {
            "CHECKSUM": data[0],
            "COUNTER": counter,
            "Status": status,
            "MeanOffset": -3276.8 if mean is None else mean / 10,
            "WorstOffset": -3276.8 if worst is None else worst / 10,
            "Age": 6553.5 if age is None else age / 10,
        }
    )
    theirs = encode(name, signals)
    assert decode_baseline(BASELINE_ID + node, theirs)[:3] == (node, counter, status)
    assert theirs == data
