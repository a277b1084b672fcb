"""The named operating points: what they set, whom they refuse, and that their figures are the report's."""

import json
from pathlib import Path

import pytest
from msgspec.structs import replace

from firmware_interface.wire_timing import can_bits_per_s
from footsense.config import DEFAULT
from footsense.config.operating_points import OPERATING_POINTS, at_operating_point
from footsense.config.sections import Can, Scan
from footsense.errors import ConfigError
from tests.system.command import footsense, run_json

REPORT = Path(__file__).parents[3] / "docs" / "report" / "tradeoff.json"
POINTS = json.loads(REPORT.read_text(encoding="utf-8"))["points"]


def test_a_point_replaces_two_settings_and_no_others() -> None:
    """The order of the scan stays that of the file."""
    moved = at_operating_point(replace(DEFAULT, scan=Scan(order="raster"), publish_every=9), "low-noise")
    low_noise = OPERATING_POINTS["low-noise"]
    assert (moved.scan.rate_sps, moved.publish_every) == low_noise[:2]
    assert moved.scan.order == "raster"
    assert replace(moved, scan=DEFAULT.scan) == DEFAULT


def test_the_default_is_a_point() -> None:
    """A robot whose file says nothing of it runs at `default`."""
    said = replace(DEFAULT, scan=replace(DEFAULT.scan, rate_sps=DEFAULT.rate_sps))
    assert at_operating_point(DEFAULT, "default") == said


def test_a_point_that_can_does_not_carry_is_refused() -> None:
    """As the same settings in a file are, with what would be right."""
    robot = replace(DEFAULT, can=Can(interface="socketcan", bitrate=500_000))
    with pytest.raises(
        ConfigError, match=r"operating point low-latency: can\.bitrate: 6 legs .* use 1000000"
    ):
        at_operating_point(robot, "low-latency")
    assert at_operating_point(robot, "default").publish_every == 4


def test_the_default_loads_a_bus_of_500_kbit_by_less_than_40_percent() -> None:
    """All frames of six legs, events of two steps a second included."""
    assert can_bits_per_s(len(DEFAULT.legs), DEFAULT.forces_hz) < 0.4 * 500_000


def test_can_fd_carries_a_force_for_every_conversion() -> None:
    """One frame for all legs: what 500 kbit/s cannot carry in single frames."""
    robot = replace(DEFAULT, can=Can(interface="socketcan", bitrate=500_000, fd=True))
    assert at_operating_point(robot, "low-latency").publish_every == 1


def test_run_obeys_the_name_and_refuses_another() -> None:
    """A name that is none is a usage error that lists those that are."""
    figures = run_json("--operating-point", "low-noise", "--duration", "2", "--fast")
    assert figures["cycle_rate_hz"] < 100
    result = footsense("run", "--operating-point", "loud", "--duration", "1")
    assert result.returncode == 2
    assert "'low-noise', 'default', 'low-latency'" in result.stderr


@pytest.mark.parametrize("name", list(OPERATING_POINTS))
def test_the_figures_are_those_of_the_report(name: str) -> None:
    """Rounded as they are written."""
    point = OPERATING_POINTS[name]
    found = next(p for p in POINTS if (p["rate_sps"], p["publish_every"]) == point[:2])
    assert point.median_force_age_ms == pytest.approx(found["walk"]["held_age_p50_p99_ms"][0], abs=0.5)
    assert point.walk_force_rmse_mn == pytest.approx(found["walk"]["held_error_norm_rms_mn"], abs=1.0)
    assert point.noise_mn == pytest.approx(found["standing_noise_norm_rms_mn"], rel=0.05)
