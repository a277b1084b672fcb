"""The alerts of deploy/prometheus fire in a fault and clear behind it, judged by Prometheus itself.

Five have a fault of a simulated robot. Of the others the metrics are given: a loop that stands still, deadlines
that are missed, overload, and what `footsense selfcal` says.
"""

import shutil
import subprocess
from collections import defaultdict
from pathlib import Path

import msgspec
import pytest
import yaml
from prometheus_client import CollectorRegistry

from footsense.config import load_config
from footsense.daemon.service import open_service
from footsense.ports import WAKEUP_LATENCY_BUCKET_BOUNDS_S
from footsense.sim.scene import load_scene
from footsense.telemetry.electrodes import ElectrodesSeen, electrode_metrics
from footsense.telemetry.metrics import ServiceMetrics
from tests.support.seen import Seen

pytestmark = pytest.mark.slow

ALERTS = Path(__file__).parents[2] / "deploy" / "prometheus" / "alerts.yaml"
ROBOT = """
buses:
  - {device: sim0, addresses: {lf: 0x2C, lm: 0x2D, lr: 0x2E}}
  - {device: sim1, addresses: {rf: 0x2C, rm: 0x2D, rr: 0x2E}}
can: {interface: virtual}
"""
SCENE = """
description: A tripod gait, in which something else breaks on each leg, and is mended; then nobody hears.
foot_type: aoyagi-3x3
load: {kind: tripod, period_s: 1.2, duty_rel: 0.6, peak_force_n: 0.8}
gait_table: true
effects: {converter_noise: true}
faults:
  - {at_s: 10, until_s: 20, leg: lf, fault: absent}
  - {at_s: 4, until_s: 40, leg: lr, fault: element_stuck, element: 0}
  - {at_s: 10, until_s: 30, legs: [rf], fault: white_noise, noise_ff: 30}
  - {at_s: 10, until_s: 20, leg: rm, fault: gap_closed, element: 4}
  - {at_s: 15, until_s: 20, fault: can_no_ack}
"""
#: Seconds of the run, of the silence behind it, and of what comes then.
RUN_S, SILENT_S, AGAIN_S = 50, 30, 30
#: Alert, leg, times at which it fires, and at which it does not [s].
EXPECTED = [
    ("FootsenseLegWithoutForce", "lf", [15, 19], [5, 30]),
    ("FootsenseLegDegraded", "lr", [38], [30, 48]),
    ("FootsenseElementFault", "lr", [20, 38], [3, 48]),
    ("FootsenseLegNoisy", "rf", [25], [5, 45]),
    ("FootsenseOverload", "rr", [20], [2, 80]),
    ("FootsenseCanNotHeard", None, [18], [10, 60]),
    ("FootsenseSilent", None, [RUN_S + 28], [20, RUN_S + SILENT_S + 25]),
    ("FootsenseDeadlinesMissed", None, [20], [3, 109]),
    ("FootsenseElectrodesTurned", "lf", [84], [RUN_S, 10, 100]),
    ("FootsenseCalibrationProposed", "lf", [84], [RUN_S, 10, 100]),
]


class Scraper:
    """Prometheus beside a service: all series, a value each second."""

    def __init__(self) -> None:
        self.series: defaultdict[str, dict[int, float]] = defaultdict(dict)

    def scrape(self, t_s: int, *sources: object) -> None:
        registry = CollectorRegistry()
        for source in sources:
            registry.register(source)  # type: ignore[arg-type]
        for metric in registry.collect():
            for name, labels, value, *_ in metric.samples:
                if not name.endswith(("_bucket", "_created", "_sum", "_count")):
                    text = ",".join(f'{key}="{word}"' for key, word in labels.items())
                    self.series[f"{name}{{{text}}}"][t_s] = value


class _Electrodes:
    def __init__(self, turn_deg: float, objection: str = "") -> None:
        self._turn_deg, self._objection = turn_deg, objection

    def collect(self) -> object:
        seen: dict[str, object] = {"of": {"leg": "lf"}, "turn_deg": self._turn_deg, "turn_sigma_deg": 0.8}
        seen["objection"] = self._objection
        return electrode_metrics([msgspec.convert(seen, ElectrodesSeen)])


def _labels(alert: str, leg: str | None) -> str:
    return f'alertname="{alert}",alertstate="firing"' + (f',leg="{leg}"' if leg else "")


def test_each_alert_fires_in_its_fault_and_clears_behind_it(tmp_path: Path) -> None:
    if shutil.which("promtool") is None:
        pytest.skip("promtool is not here: Debian's package prometheus has it")
    robot, scene = tmp_path / "robot.yaml", tmp_path / "scene.yaml"
    robot.write_text(ROBOT)
    scene.write_text(SCENE)
    scraper = Scraper()
    with open_service(load_config(robot), load_scene(str(scene)), real_time=False) as service:
        metrics = ServiceMetrics(("lf", "lm", "lr", "rf", "rm", "rr"))
        begin_ns = service.clock.now_ns()

        seen = Seen()
        service.observers.append(seen)
        for t_s in range(RUN_S):
            service.run(until_ns=begin_ns + (t_s + 1) * 1e9)
            for cycle in seen.cycles:
                metrics.add(cycle)
            seen.cycles.clear()
            n_missed = 20 * max(min(t_s, 30) - 5, 0)
            histogram = [0.0] * (len(WAKEUP_LATENCY_BUCKET_BOUNDS_S) + 2)  # virtual time has none
            metrics.status = msgspec.structs.replace(
                service.status(), wakeup_histogram=histogram, n_late_discards=n_missed
            )
            scraper.scrape(t_s, metrics, *([_Electrodes(4.0)] if t_s > 20 else []))
        for t_s in range(RUN_S, RUN_S + SILENT_S):
            scraper.scrape(t_s, metrics, _Electrodes(4.0))
    for t_s in range(RUN_S + SILENT_S, RUN_S + SILENT_S + AGAIN_S):
        for values in scraper.series.values():
            values[t_s] = values[t_s - 1]
        scraper.series["footsense_cycles_total{}"][t_s] += 145.0
        if t_s > 90:  # a calibration was accepted
            scraper.scrape(t_s, _Electrodes(0.5, "no improvement to expect"))
    for t_s in range(3, 7):  # what no scene of a foot within its range has
        scraper.series['footsense_leg_cause{leg="rr",cause="overload"}'][t_s] = 1.0
    tests = [
        {
            "expr": f"count(ALERTS{{{_labels(alert, leg)}}}) or vector(0)",
            "eval_time": f"{t_s}s",
            "exp_samples": [{"labels": "{}", "value": float(fires)}],
        }
        for alert, leg, *times in EXPECTED
        for fires, some in zip((True, False), times, strict=True)
        for t_s in some
    ]
    file = tmp_path / "tests.yaml"
    n = RUN_S + SILENT_S + AGAIN_S
    series = [
        {"series": name, "values": " ".join(repr(values[t]) if t in values else "_" for t in range(n))}
        for name, values in scraper.series.items()
    ]
    content = {
        "rule_files": [str(ALERTS)],
        "evaluation_interval": "1s",
        "tests": [{"interval": "1s", "input_series": series, "promql_expr_test": tests}],
    }
    file.write_text(yaml.safe_dump(content))
    judged = subprocess.run(
        ["promtool", "test", "rules", str(file)], capture_output=True, text=True, timeout=120, check=False
    )
    assert judged.returncode == 0, judged.stdout + judged.stderr
    names = {rule["alert"] for rule in yaml.safe_load(ALERTS.read_text())["groups"][0]["rules"]}
    assert names == {alert for alert, *_ in EXPECTED}
