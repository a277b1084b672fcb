"""YAML either becomes the object it describes, or one line that says where and why not."""

import json
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta, Struct

from footsense.errors import ConfigError
from footsense.plain_yaml import MAX_BYTES
from footsense.strict_yaml import Problem, load


class Mux(Struct, frozen=True, forbid_unknown_fields=True):
    address: Annotated[int, Meta(ge=0x70, le=0x77, description="three pins")]


class Ramp(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="ramp"):
    slope_n_per_s: float


class Step(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="step"):
    force_n: float


class Robot(Struct, frozen=True, forbid_unknown_fields=True):
    mux: Mux
    rate_sps: Literal[100, 200, 400] = 400
    legs: dict[Literal["lf", "rf"], Annotated[int, Meta(ge=0, le=7)]] = {}
    stray_pf: Annotated[tuple[float, ...], Meta(max_length=2)] = ()
    load: Ramp | Step | None = None
    quiet: bool = False


GOOD = "mux: {address: 0x71}\n"


def refusal(text: str | bytes | Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load(text, Robot, None if isinstance(text, Path) else "robot.yaml")
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_reads_what_fits() -> None:
    """Hexadecimal numbers, mappings, lists and tagged choices become the frozen structs."""
    robot = load(GOOD + "legs: {lf: 3}\nstray_pf: [1, 2.5]\nload: {kind: step, force_n: 2}", Robot)
    assert robot == Robot(Mux(0x71), legs={"lf": 3}, stray_pf=(1.0, 2.5), load=Step(2.0))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("mux:\n  adress: 0x71", "robot.yaml:2: mux.adress: unknown key; did you mean address?"),
        ("mux: {a: 1}", "mux.a: unknown key; there are address"),
        ("mux: {}", "mux: the key address is missing: a whole number from 112 to 119 (three pins)"),
        ("mux:", ":1: mux: an empty value is wrong; it has to be a section of keys"),
        (
            "mux: {address: 0x78}",
            ":1: mux.address: 120 is wrong; it has to be a whole number from 112 to 119 (three pins)",
        ),
        ("mux: {address: 1e2}", '"1e2" is wrong; it has to be a whole number from 112 to 119 (three pins)'),
        (GOOD + "rate_sps: 300", ":2: rate_sps: '300' is none of 100, 200, 400"),
        (
            GOOD + "legs:\n  lf: 1\n  rf: 9",
            ":4: legs.rf: 9 is wrong; it has to be a whole number from 0 to 7",
        ),
        (GOOD + "legs: {fl: 1}", ":2: legs.fl: 'fl' is none of lf, rf; did you mean lf?"),
        (GOOD + "load: [1]", ":2: load: a list of 1 is wrong; it has to be a section of keys"),
        (GOOD + "stray_pf:\n- 1\n- x", ':4: stray_pf[1]: "x" is wrong; it has to be a number'),
        (GOOD + "stray_pf: [1, 2, 3]", "stray_pf: a list of 3 is wrong; it has to be a list, at most 2"),
        (GOOD + "load: {kind: stop}", "load.kind: 'stop' is none of ramp, step; did you mean step?"),
        (GOOD + "load: {kind: [step]}", "load.kind: \"['step']\" is none of ramp, step"),
        (GOOD + "load: {force_n: 1}", "load: the key kind is missing: one of ramp, step"),
        (GOOD + "quiet: 1", ":2: quiet: 1 is wrong; it has to be true or false"),
        (GOOD + "mux: {address: 0x72}", ":2: the key 'mux' stands twice, first on line 1"),
        (
            GOOD + "load:\n\tkind: step",
            "robot.yaml:3: the line begins with a tab; YAML is indented with spaces",
        ),
        (GOOD + "load:\n  <<: {kind: step}", ":3: a key has to be a single word, not '<<'"),
        (GOOD + "? [a]\n: 1", ":2: a key has to be a single word, not 'a section or list'"),
        (GOOD + "stray_pf: [.nan]", ":2: .nan is not a finite number"),
        (
            GOOD + "stray_pf: [2026-01-01]",
            ":2: '2026-01-01' reads as a timestamp, which is not supported; quote it",
        ),
        (GOOD + "stray_pf: !!set {}", ":2: the tag tag:yaml.org,2002:set is not supported; take it away"),
        ("mux: &m {address: 0x71}", ":1: aliases (& and *) are not supported; write the values out"),
        ("- a", "robot.yaml:1: a list of 1 is wrong; it has to be a section of keys"),
        ("mux: [", "is not valid YAML, here or just above: "),
        (GOOD + "---\n" + GOOD, "robot.yaml: holds several documents, separated by ---; one is read"),
        ("", "robot.yaml: is empty"),
        ("---\n", "robot.yaml: is empty"),
        (b"mux: \xff", "robot.yaml: is not UTF-8 text: byte 5 is 0xff"),
        (" " * (MAX_BYTES + 1), f"has more than the {MAX_BYTES} bytes that are read"),
    ],
)
def test_says_what_is_wrong_and_where(text: str | bytes, wanted: str) -> None:
    """Every refusal is one line with the place, the path, the fault and the remedy."""
    assert wanted in refusal(text)


def test_names_the_file(tmp_path: Path) -> None:
    """A missing file and a directory are refused by name."""
    assert refusal(tmp_path / "none.yaml") == f"{tmp_path / 'none.yaml'}: no such file"
    assert "cannot be read: Is a directory" in refusal(tmp_path)


def test_a_check_names_the_line_of_a_contradiction() -> None:
    """What the caller finds contradictory is reported like any other fault."""
    with pytest.raises(ConfigError, match=r"^r.yaml:3: legs.rf: taken$"):
        load(GOOD + "legs: {lf: 1,\n rf: 1}", Robot, "r.yaml", lambda _: Problem("legs.rf", "taken"))


words = st.sampled_from(
    ["mux", "address", "legs", "lf", "load", "kind", "step", "force_n", "stray_pf", "quiet", "x"]
)
scalars = st.none() | st.booleans() | st.integers() | st.floats(-1e9, 1e9) | words
nested = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=4)
)


@given(nested)
def test_any_data_load_or_are_refused_in_plain_words(data: object) -> None:
    """Whatever stands where: a message of ours, with a path, and none of msgspec's."""
    said = "it fits"
    try:
        load(json.dumps(data), Robot, "robot.yaml")
    except ConfigError as error:
        said = str(error)
    assert "Expected" not in said
