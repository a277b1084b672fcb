"""ONNX files: damaged, and forged with a checksum that is right."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import ModelProto, TensorProto, helper

from footsense.daemon.foot_types import released_path
from footsense.errors import ModelError
from footsense.estimation.network import Network
from footsense.foot.network_card import INPUTS, OUTPUTS, add_checksum, read_card
from tests.fuzz.outcome import EXAMPLES, NO_MESSAGE, TRIED, anything, judged_with_little_memory, refusal
from tests.support.networks import network_of_nodes

WHOLE = released_path("network.onnx").read_bytes()
CARD = json.loads(
    {entry.key: entry.value for entry in ModelProto.FromString(WHOLE).metadata_props}["footsense_card"]
)


@given(data=st.data())
@TRIED
def test_no_damage_is_taken(tmp_path: Path, data: st.DataObject) -> None:
    """Whatever bit is flipped, wherever the file is cut: refused, before the runtime sees it."""
    at = data.draw(st.integers(0, len(WHOLE) - 1))
    damaged = bytearray(WHOLE)
    damaged[at] ^= 1 << data.draw(st.integers(0, 7))
    for content in (damaged, WHOLE[:at], WHOLE + WHOLE[:at] if at else b""):
        (tmp_path / "network.onnx").write_bytes(content)
        said = refusal(lambda: Network(tmp_path / "network.onnx", 12), ModelError)
        assert said
        assert "checksum" in said


@given(seed=st.integers(0, 2**32 - 1))
@settings(TRIED, max_examples=1 + EXAMPLES // 100)
def test_forged_files_hurt_nobody(tmp_path: Path, seed: int) -> None:
    """Bytes changed under a checksum that is made anew: the runtime takes them or refuses, and lives on."""
    content, rng, files = WHOLE[:-86], np.random.default_rng(seed), []
    assert add_checksum(content) == WHOLE
    for n in range(150):
        changed = bytearray(content)
        structure = rng.integers(0, 3000, 2), len(content) - 1 - rng.integers(0, 6000, 2)
        for at in (*structure[n % 2], rng.integers(0, len(content)))[: 1 + n % 3]:
            changed[at] = rng.integers(0, 256)
        files.append(tmp_path / f"{n}.onnx")
        files[-1].write_bytes(add_checksum(bytes(changed)))
    assert sum(" refused: " in line for line in judged_with_little_memory(1024, *files)) > 10


def test_a_name_that_is_no_text(tmp_path: Path) -> None:
    """Bytes that are no UTF-8, where the number of rows of an input or output is named."""
    content, path = WHOLE[:-86], tmp_path / "network.onnx"
    places = [match.start() for match in re.finditer(rb"\n\x03\x12\x01n", content)]
    assert len(places) == len((*INPUTS, *OUTPUTS))
    for at in places:
        path.write_bytes(add_checksum(content[: at + 4] + b"\x87" + content[at + 5 :]))
        assert refusal(lambda: Network(path, 1), ModelError)


def test_a_network_that_asks_for_too_much(tmp_path: Path) -> None:
    """Room for 10^18 numbers, a shape of negative size, and outputs of another size than declared."""
    parts = [
        *(("age_s", "three", "sigma_n"), ("age_s", "four", "contact"), ("age_s", "four", "contact_sigma")),
        ("closure_rel", "three", "part"),
    ]
    cut = [helper.make_node("Slice", [value, "zero", end, "one"], [name]) for value, end, name in parts]
    summed = [
        helper.make_node("ConstantOfShape", ["size"], ["room"]),
        helper.make_node("ReduceSum", ["room"], ["sum"], keepdims=0),
        helper.make_node("Add", ["part", "sum"], ["force_n"]),
    ]
    files: list[Path] = []
    for nodes, size in (
        *((summed, size) for size in ([10**9, 10**9], [1 << 62, 4], [-5, 3], [100_000, 10_000])),
        ([helper.make_node("ConstantOfShape", ["size"], ["force_n"])], [7, 3]),
    ):
        constants = {"size": size, "zero": [0], "three": [3], "four": [4], "one": [1]}
        tensors = [
            helper.make_tensor(name, TensorProto.INT64, [len(value)], value)
            for name, value in constants.items()
        ]
        path = tmp_path / f"{len(files)}.onnx"
        files.append(network_of_nodes(path, json.dumps(CARD), [*cut, *nodes], tensors))
    for line in judged_with_little_memory(1024, *files):
        assert " refused: " in line


@given(key=st.sampled_from(sorted(CARD)), value=anything)
@TRIED
def test_a_forged_card(key: str, value: Any) -> None:
    """One entry replaced by anything; nesting without end, and JSON that is no card."""
    refusal(lambda: read_card(json.dumps({**CARD, key: value}), "network.onnx"), ModelError)
    for text in NO_MESSAGE:
        assert refusal(lambda text=text: read_card(text, "network.onnx"), ModelError)  # type: ignore[misc]
