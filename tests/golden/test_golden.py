"""A recorded walk still gives the forces that it gave when it was recorded."""

import json
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from footsense.frames import State, Vector
from footsense.recording import messages
from footsense.recording.mcap_writer import McapFile
from footsense.recording.replay import Replay
from footsense.ring.records import NumberedCycle
from tests.system.command import footsense

GOLDEN = Path(__file__).parent / "measured_walk.mcap"
SMALL_BOARD = GOLDEN.with_name("small_board.mcap")
#: Of the default board, and of `fdc1004`.
BOTH = pytest.mark.parametrize("file", [GOLDEN, SMALL_BOARD], ids=attrgetter("stem"))


@BOTH
def test_the_golden_walk_is_a_walk(file: Path) -> None:
    """Seconds of six legs that are tared, carry and swing: a replay of nothing would prove nothing."""
    cycles = list(Replay(file))
    assert len(cycles) > 150
    fz_n = [cycle.forces.force_n[:, 2] for cycle in cycles if (cycle.forces.state == State.VALID).all()]
    assert len(fz_n) > 120
    assert all(max(forces) > 0.9 for forces in zip(*fz_n, strict=True))
    assert all(min(forces) < 0.01 for forces in zip(*fz_n, strict=True))


#: OpenBLAS chooses its routines by the first, NumPy its own by the second: as the processor has them, for AVX2, and
#: those of a processor without FMA. What a machine does not know of them changes nothing.
_PROCESSORS: dict[str, dict[str, str | None]] = {
    "no choice": {"OPENBLAS_CORETYPE": None, "OPENBLAS_L2_SIZE": None},
    "AVX2": {"OPENBLAS_CORETYPE": "Haswell"},
    "without FMA": {
        "OPENBLAS_CORETYPE": "Prescott",
        "NPY_DISABLE_CPU_FEATURES": "AVX512_SKX AVX512F AVX2 FMA3 F16C AVX",
    },
}


@pytest.mark.parametrize(
    ("file", "processor"),
    [(GOLDEN, "no choice"), (GOLDEN, "AVX2"), (SMALL_BOARD, "no choice"), (SMALL_BOARD, "without FMA")],
    ids=["default-no-choice", "default-avx2", "small-no-choice", "small-without-fma"],
)
def test_the_golden_walk_gives_the_same_forces(
    file: Path, processor: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To 1 mN on any processor, and the line says how many bit for bit."""
    for name, value in _PROCESSORS[processor].items():
        if value is None:
            monkeypatch.delenv(name, raising=False)
        else:
            monkeypatch.setenv(name, value)
    result = footsense("replay", file, "--check")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.startswith(f"{len(list(Replay(file)))} cycles equal ")


@pytest.mark.slow
def test_a_recording_whose_last_bits_differ_is_equal_and_not_exact(tmp_path: Path) -> None:
    """As another processor would have made it; a force that is off by 2 mN is none of these."""
    near, far = tmp_path / "near.mcap", tmp_path / "far.mcap"
    n_cycles = copy_changed(
        GOLDEN.with_name("small_board.mcap"), near, lambda force_n: np.nextafter(force_n, 9.0)
    )
    copy_changed(SMALL_BOARD, far, lambda force_n: force_n + 2e-3)
    equal = footsense("replay", near, "--check")
    assert (equal.returncode, equal.stderr) == (0, "")
    assert re.match(
        rf"{n_cycles} cycles equal to 1 mN, \d+ bit for bit; largest differences: fx_n \de-1\d, ",
        equal.stdout,
    )
    for refused in (footsense("replay", near, "--exact"), footsense("replay", far, "--check")):
        assert refused.returncode == 1
        assert re.search(r"leg lf: fx_n was \S+, is now ", refused.stderr)


def copy_changed(source: Path, target: Path, change: Callable[[Vector], Vector]) -> int:
    """Copy a recording with other forces on the first leg; return its number of cycles."""
    recording = Replay(source)
    with target.open("wb") as out:
        copy = McapFile(out.fileno(), recording.header)
        for entry in recording.entries():
            assert isinstance(entry, NumberedCycle)
            forces = entry.cycle.forces
            force_n = forces.force_n.copy()
            force_n[0] = change(force_n[0])
            copy.add_entry(
                entry._replace(cycle=entry.cycle._replace(forces=forces._replace(force_n=force_n)))
            )
        copy.finish()
    return copy.n_cycles


def paths(value: object) -> Iterator[str]:
    """Yield the path of every entry of nested objects."""
    if isinstance(value, dict):
        for key, entry in value.items():
            yield key
            yield from (f"{key}.{path}" for path in paths(entry))


def properties(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the properties of a schema, and theirs."""
    return {key: properties(entry) for key, entry in schema.get("properties", {}).items()}


def test_every_message_has_the_keys_of_its_schema() -> None:
    """A viewer that reads the schema finds each field, and none that no message has; events differ by their kind."""
    told: dict[str, set[str]] = defaultdict(set)
    with GOLDEN.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            told[channel.topic] |= set(paths(json.loads(message.data)))
    legs = Replay(GOLDEN).legs
    for topic, schema in messages.topic_schemas(legs).items():
        if topic == messages.REFERENCE:  # on a test stand alone
            continue
        listed = set(paths(properties(json.loads(schema))))
        assert told[topic] <= listed if topic == messages.EVENT else told[topic] == listed, topic
