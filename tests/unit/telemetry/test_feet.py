"""Odometers of the feet: what is counted, and what a restart, another foot, or a damaged file makes of them."""

import json
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from prometheus_client import CollectorRegistry

from footsense.frames import CanStatistics, Cause, Cycle, Flag, GaitEvent, GaitEventKind, State
from footsense.ring.cycle_ring import CycleRing
from footsense.ring.records import ServiceStatus
from footsense.telemetry.exporter import ServiceCollector
from footsense.telemetry.feet import SAVE_PERIOD_NS, Odometer
from tests.support.cycles import plain_cycle
from tests.support.frames import gait_frame

MS = 1_000_000
LEGS = ("lf", "rr")
STATUS = ServiceStatus(CanStatistics(), np.zeros(18).tobytes())
ROBOT = {
    "feet": "lf=foot-0007",
    "config": '{"board": "ad7147"}',
    "footsense": "1.2",
    "model_sha256": "ab" * 32,
}


def cycle(t_ms: int, *, contact: bool = True, steps: int = 0, force_n: float = 0.5, **forces: Any) -> Cycle:
    """Return a cycle in which the left foot steps, stands, and bears a force."""
    events = tuple(GaitEvent(GaitEventKind.TOUCHDOWN, 0, 0, 0.01) for _ in range(steps))
    events += (GaitEvent(GaitEventKind.LIFT_OFF, 1, 0, 0.01),)
    flags = np.array([Flag.CONTACT if contact else 0, 0], np.uint8)
    force = np.array([[0.0, 0.6 * force_n, 0.8 * force_n], [np.nan] * 3])
    gait = gait_frame(t_ms * MS, 2, events=events)
    values = {"flags": flags, "force_n": force, "gait": gait, **forces}
    return plain_cycle(t_ms * MS, (State.VALID, State.ABSENT), **values)


class Scraped:
    """The exporter of a robot whose odometers are kept in a file."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.file = folder, folder / "odometer/feet.json"
        self.collector = ServiceCollector(folder / "ring", folder, self.file)
        self._registry = CollectorRegistry()
        self._registry.register(self.collector)

    def serve(self, *cycles: Cycle, header: dict[str, str] = ROBOT) -> CycleRing:
        """Return the ring of a service that has written cycles."""
        self.collector.poll()
        ring = CycleRing(self.folder / "ring", LEGS, header, 400.0, lambda: STATUS)
        for one in cycles:
            ring.observe(one)
        return ring

    def of(self, foot: str) -> list[float | None]:
        names = ("steps_total", "contact_seconds_total", "peak_force_newtons", "over_range_seconds_total")
        leg = {"foot-0007": "lf", "foot-0008": "lf"}.get(foot, foot)
        labels = {"leg": leg, "foot": foot}
        return [self._registry.get_sample_value(f"footsense_foot_{name}", labels) for name in names]

    def info(self, name: str, **labels: str) -> float | None:
        return self._registry.get_sample_value(f"footsense_{name}", labels)


def test_steps_contact_peak_and_overload_are_counted_by_the_foot_on_the_leg(tmp_path: Path) -> None:
    """A time that nobody saw is not; a force that is not known is none."""
    scraped = Scraped(tmp_path)
    over = np.array([Cause.OVERLOAD, Cause.NONE], np.uint8)
    seen = (
        *(cycle(1000, steps=1), cycle(1100, force_n=1.5), cycle(1300, cause=over)),
        *(cycle(1400, contact=False), cycle(9000, steps=2), cycle(9100)),
    )
    with closing(scraped.serve(*seen)):
        assert scraped.of("foot-0007") == pytest.approx([3, 0.4, 1.5, 0.2])
        assert scraped.of("rr") == [0, 0, 0, 0]
        assert scraped.info("foot_info", leg="lf", foot="foot-0007", calibration="") == 1
        labels = {"version": "1.2", "board": "ad7147", "foot_type": "", "network": "abababababab"}
        assert scraped.info("info", **labels) == 1


def test_they_survive_restarts_of_service_and_exporter_and_stay_with_the_foot(tmp_path: Path) -> None:
    for n in (1, 2):
        scraped = Scraped(tmp_path)
        for k in (0, 1):
            with closing(scraped.serve(cycle(1000), cycle(1200, steps=1))):
                assert scraped.of("foot-0007") == pytest.approx(
                    [2 * n - 1 + k, 0.4 * n - 0.2 + 0.2 * k, 0.5, 0]
                )
            scraped.collector.poll()
    with closing(scraped.serve(cycle(1000, steps=5), header=ROBOT | {"feet": "lf=foot-0008"})):
        assert scraped.of("foot-0008")[0] == 5
    scraped.collector.close()
    feet = json.loads(scraped.file.read_text())["feet"]
    assert {name: foot["steps"] for name, foot in feet.items()} == {"foot-0007": 4, "foot-0008": 5, "rr": 0}


def test_the_file_is_written_seldom_and_not_for_a_robot_that_stands_or_is_simulated(tmp_path: Path) -> None:
    """A power cut costs five minutes; a simulation has no feet that wear."""
    file = tmp_path / "feet.json"
    odometer = Odometer(file)
    odometer.begin(ROBOT, LEGS)
    period_ms = SAVE_PERIOD_NS // MS
    for t_ms, steps, is_written in ((1000, 1, False), (period_ms, 1, False), (period_ms + 1000, 0, True)):
        odometer.add(cycle(t_ms, steps=steps, contact=False))
        odometer.save(now=False)
        assert file.exists() == is_written
    written_ns = file.stat().st_mtime_ns
    odometer.add(cycle(3 * period_ms, contact=False))
    odometer.save()
    assert file.stat().st_mtime_ns == written_ns
    file.unlink()
    odometer.begin({**ROBOT, "scene": "{}"}, LEGS)
    odometer.add(cycle(1000, steps=1))
    odometer.save()
    assert not file.exists()


FOREIGN = [b"", b'{"footsense": "odometer", "feet": {"foot-0007": {"st', b'{"feet": {}}', b"[" * 100_000]
FOREIGN += [
    b'{"footsense": "odometer", "feet": {"foot-0007": {"steps": -1}}}',
    b'{"\xff": 1}',
    b"x" * (2 << 20),
]


@pytest.mark.parametrize("content", FOREIGN)
def test_a_torn_or_foreign_file_is_one_line_and_kept_aside(
    tmp_path: Path, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    scraped = Scraped(tmp_path)
    scraped.file.parent.mkdir()
    scraped.file.write_bytes(content)
    with closing(scraped.serve(cycle(1000, steps=1))):
        assert scraped.of("foot-0007")[0] == 1
    scraped.collector.close()
    (line,) = [text for text in caplog.messages if "odometer" in text]
    assert "they begin at zero, it is kept as" in line
    assert "\n" not in line
    assert len(line) < 1000
    assert scraped.file.with_suffix(".json.old").read_bytes() == content
    assert json.loads(scraped.file.read_text())["feet"]["foot-0007"]["steps"] == 1


def test_a_folder_that_cannot_be_written_costs_the_file_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """One line, however often it is tried."""
    scraped = Scraped(tmp_path)
    scraped.file.parent.write_text("in the way")
    for n in (1, 2):
        with closing(scraped.serve(cycle(1000, steps=n))):
            assert scraped.of("foot-0007")[0] == n
        scraped.collector.poll()
    assert len([text for text in caplog.messages if "cannot be kept" in text]) == 1
