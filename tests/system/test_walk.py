"""A walk from end to end: what an independent decoder reads on CAN, the truth beside it, and the same again."""

from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import can
import cantools
import pytest

import firmware_interface
from tests.system.command import run_json

DBC = Path(firmware_interface.__file__).parent / "can/footsense.dbc"


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A measured walk without any configuration: its log of CAN, and its figures."""
    log = tmp_path_factory.mktemp("walk") / "walk.log"
    return log, run_json("--scene", "measured_walk", "--duration", "6", "--can-log", log)


def crc8_bitwise(can_id: int, data: bytes) -> int:
    """AUTOSAR E2E profile 11 variant A, bit by bit: written here so as to share nothing with the package."""
    crc = 0
    for byte in bytes((can_id & 0xFF, can_id >> 8)) + data[1:]:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1) ^ (0x1D if crc & 0x80 else 0)
            crc &= 0xFF
    return crc


def test_every_frame_decodes_with_plain_cantools_and_is_protected_right(
    walk: tuple[Path, dict[str, Any]],
) -> None:
    """Each crc is right, each counter goes on by one, and forces arrive with every fourth conversion, or a change."""
    database = cantools.database.load_file(DBC)
    counters: dict[int, list[int]] = defaultdict(list)
    n_frames = 0
    for message in can.LogReader(walk[0]):
        n_frames += 1
        definition = database.get_message_by_frame_id(message.arbitration_id)
        signals = definition.decode(message.data, decode_choices=False)
        assert isinstance(signals, dict)
        assert len(message.data) == definition.length
        if "CHECKSUM" in signals:
            assert signals["CHECKSUM"] == crc8_bitwise(message.arbitration_id, bytes(message.data))
            counters[message.arbitration_id].append(int(signals["COUNTER"]))
    for can_id, values in counters.items():
        assert all(b == (a + 1) % 15 for a, b in pairwise(values)), hex(can_id)
    for node in range(1, 7):
        assert len(counters[0x108 + node]) == len(counters[0x118 + node]) == walk[1]["can"]["published"]
    assert 0.5 <= walk[1]["can"]["published"] / walk[1]["cycles"] < 0.55
    assert n_frames == walk[1]["can"]["sent"]
    assert walk[1]["can"]["dropped"] == 0


def test_the_forces_are_those_that_the_feet_felt(walk: tuple[Path, dict[str, Any]]) -> None:
    """Errors against the truth at the time of sending: a heel strike is in them."""
    figures = walk[1]
    assert figures["cycle_rate_hz"] == pytest.approx(148, abs=2)
    assert figures["faulty_leg_cycles"] == 0
    assert max(figures["force_rmse_n"].values()) < 0.05
    assert figures["direction_error_deg"]["mean"] < 1.5
    assert figures["direction_error_deg"]["loaded_frames"] > 500
    assert 2.3 < figures["age_ms"]["p50"] < 3.0


@pytest.mark.slow
def test_a_run_is_the_same_each_time(tmp_path: Path) -> None:
    """Virtual time: two runs put the same bytes on CAN at the same times, with one bus and with two."""
    two_buses = tmp_path / "two.yaml"
    deployed = Path(__file__).parents[2] / "deploy" / "footsense-two-buses.yaml"
    two_buses.write_text(deployed.read_text().replace("socketcan", "virtual").partition("\nmetrics:")[0])
    for options in ((), ("--config", two_buses, "--scene", "tripod")):
        logs = []
        for n in range(2):
            log = tmp_path / f"{len(options)}-{n}.log"
            run_json(*options, "--duration", "2", "--can-log", log)
            logs.append(log.read_bytes())
        assert logs[0] == logs[1]
        assert len(logs[0]) > 10_000
