"""A recorded walk still gives the forces that it gave when it was recorded."""

import json
from collections import defaultdict
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from footsense.frames import State
from footsense.recording import messages
from footsense.recording.replay import Replay
from tests.system.command import footsense

GOLDEN = Path(__file__).parent / "measured_walk.mcap"
#: Of board `fdc1004_columns`, and of `fdc1004`.
BOTH = pytest.mark.parametrize("file", [GOLDEN, GOLDEN.with_name("small_board.mcap")], ids=attrgetter("stem"))


@BOTH
def test_the_golden_walk_is_a_walk(file: Path) -> None:
    """Seconds of six legs that are tared, carry and swing: a replay of nothing would prove nothing."""
    cycles = list(Replay(file))
    assert len(cycles) > 150
    fz_n = [cycle.forces.force_n[:, 2] for cycle in cycles if (cycle.forces.state == State.VALID).all()]
    assert len(fz_n) > 120
    assert all(max(forces) > 0.9 for forces in zip(*fz_n, strict=True))
    assert all(min(forces) < 0.01 for forces in zip(*fz_n, strict=True))


@BOTH
def test_the_golden_walk_gives_the_same_forces(file: Path) -> None:
    """Bit for bit on the machine that recorded it, to 1 mN on any other."""
    result = footsense("replay", file, "--check")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.startswith(f"{len(list(Replay(file)))} cycles equal")


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
