"""The alerts of deploy/prometheus fire in a fault and clear behind it, judged by Prometheus itself.

The faults are those of a simulated robot, and of made feet whose electrodes turn their forces. Only missed deadlines
are given: virtual time has none. The queries of the dashboard are asked of the same robot.
"""

import json
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import msgspec
import numpy as np
import pytest
import yaml
from prometheus_client import CollectorRegistry
from prometheus_client.core import GaugeMetricFamily, Metric

from footsense.calibration.selfcal.state import write_state
from footsense.config import load_config
from footsense.daemon.service import open_service
from footsense.foot.parameters import FootParameters
from footsense.ports import WAKEUP_LATENCY_BUCKET_BOUNDS_S
from footsense.sim.loads.load_log import LOG_ARRAYS
from footsense.sim.scene import load_scene
from footsense.telemetry.electrodes import electrode_metrics, seen_electrodes
from footsense.telemetry.feet import Odometer, identity_metrics
from footsense.telemetry.metrics import ServiceMetrics
from tests.support.seen import Seen
from tests.support.walking_foot import drifted, made_foot, walk, walking_foot

pytestmark = pytest.mark.slow

DEPLOY = Path(__file__).parents[2] / "deploy"
ALERTS, DASHBOARD = DEPLOY / "prometheus" / "alerts.yaml", DEPLOY / "grafana" / "footsense.json"
LEGS = ("lf", "lm", "lr", "rf", "rm", "rr")
ROBOT = """
buses:
  - {device: sim0, addresses: {lf: 0x2C, lm: 0x2D, lr: 0x2E}}
  - {device: sim1, addresses: {rf: 0x2C, rm: 0x2D, rr: 0x2E}}
can: {interface: virtual}
"""
SCENE = """
description: Feet that step, one of them for a while too hard; something breaks on others, and is mended; nobody hears.
foot_type: aoyagi-3x3
load: {kind: log, file: loads.npz}
effects: {converter_noise: true}
faults:
  - {at_s: 10, until_s: 20, leg: lf, fault: absent}
  - {at_s: 4, until_s: 40, leg: lr, fault: element_stuck, element: 0}
  - {at_s: 10, until_s: 30, legs: [rf], fault: white_noise, noise_ff: 30}
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
    ("FootsenseElectrodesTurned", "lm", [84], [RUN_S, 10, 100]),
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
                if not name.endswith(("_created", "_sum", "_count")):
                    text = ",".join(f'{key}="{word}"' for key, word in labels.items())
                    self.series[f"{name}{{{text}}}"][t_s] = value


class _Gauges:
    """Metrics that are not counted from cycles."""

    def __init__(self, *metrics: Metric) -> None:
        self._metrics = metrics

    def collect(self) -> Iterable[Metric]:
        return self._metrics


def _electrodes(folder: Path) -> list[_Gauges]:
    """Return what `footsense selfcal` says of two made feet, and of them when that is in use.

    The gains of one have drifted since its calibration; nobody has calibrated the other.
    """
    foot, known = made_foot(1)
    designed = FootParameters(stray_pf=np.zeros(9), unloaded_pf=foot.unloaded_pf, gap_um=np.full(9, 20.0))
    in_use, gauges = {"lf": (drifted(known, 1), "1"), "lm": (designed, "")}, []
    for seed in (0, 1):
        for leg, (parameters, calibration) in in_use.items():
            found = walking_foot(parameters, 64 * calibration, walk(foot, 21, seed=seed)[0])
            state = found.state("2026-11-29T09:00:00Z")
            of_leg = msgspec.structs.replace(state.of, leg=leg)
            write_state(folder, msgspec.structs.replace(state, of=of_leg))
            in_use[leg] = found.parameters(), "2"
        gauges.append(_Gauges(*electrode_metrics(seen_electrodes(folder))))
    return gauges


def _write_loads(file: Path) -> None:
    """Write steps of 0.5 s in 1.2 s, of 0.8 N; those of one leg have 2.4 N for some seconds."""
    t_s = np.arange(0.0, RUN_S + 1.0, 0.01)
    phase = 2.0 * np.pi * (t_s[:, None] / 1.2 + np.array([0.0, 0.5, 0.0, 0.5, 0.0, 0.5]))
    normal = np.zeros((len(t_s), len(LEGS), 3))
    normal[..., 2] = 1.0
    load_n = 0.8 * np.sqrt(np.clip(np.sin(phase), 0.0, None))
    load_n[(t_s > 5.0) & (t_s < 12.0), LEGS.index("rr")] *= 3.0
    np.savez(file, **dict(zip(LOG_ARRAYS, (LEGS, t_s, load_n[..., None] * normal, normal), strict=True)))


def _queries() -> list[str]:
    """Return the queries of the dashboard, as Grafana asks them."""
    panels = json.loads(DASHBOARD.read_text())["panels"]
    queries = [target["expr"] for panel in panels for target in panel["targets"]]
    return [query.replace("$leg", ".*").replace("$__rate_interval", "20s") for query in queries]


def _labels(alert: str, leg: str | None) -> str:
    return f'alertname="{alert}",alertstate="firing"' + (f',leg="{leg}"' if leg else "")


def test_each_alert_fires_in_its_fault_and_clears_behind_it(tmp_path: Path) -> None:
    if shutil.which("promtool") is None:
        pytest.skip("promtool is not here: Debian's package prometheus has it")
    robot, scene = tmp_path / "robot.yaml", tmp_path / "scene.yaml"
    robot.write_text(ROBOT)
    scene.write_text(SCENE)
    _write_loads(tmp_path / "loads.npz")
    turned, calibrated = _electrodes(tmp_path)
    scraper, odometer = Scraper(), Odometer()
    header = {"scene": "loads"}
    odometer.begin(header, LEGS)
    others = _Gauges(GaugeMetricFamily("footsense_up", "", 1.0), *identity_metrics(header, LEGS))
    with open_service(load_config(robot), load_scene(str(scene)), real_time=False) as service:
        metrics = ServiceMetrics(LEGS)
        begin_ns = service.clock.now_ns()

        seen = Seen()
        service.observers.append(seen)
        for t_s in range(RUN_S):
            service.run(until_ns=begin_ns + (t_s + 1) * 1e9)
            for cycle in seen.cycles:
                metrics.add(cycle)
                odometer.add(cycle)
            seen.cycles.clear()
            n_missed = 20 * max(min(t_s, 30) - 5, 0)
            histogram = [0.0] * (len(WAKEUP_LATENCY_BUCKET_BOUNDS_S) + 2)  # virtual time has none
            metrics.status = msgspec.structs.replace(
                service.status(), wakeup_histogram=histogram, n_late_discards=n_missed
            )
            scraper.scrape(t_s, metrics, odometer, others, *([turned] if t_s > 20 else []))
        for t_s in range(RUN_S, RUN_S + SILENT_S):
            scraper.scrape(t_s, metrics, odometer, others, turned)
    for t_s in range(RUN_S + SILENT_S, RUN_S + SILENT_S + AGAIN_S):
        for values in scraper.series.values():
            values[t_s] = values[t_s - 1]
        scraper.series["footsense_cycles_total{}"][t_s] += 145.0
        if t_s > 90:  # a calibration was accepted
            scraper.scrape(t_s, calibrated)
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
    tests += [
        {
            "expr": f"count({query}) > bool 0",
            "eval_time": "35s",
            "exp_samples": [{"labels": "{}", "value": 1.0}],
        }
        for query in _queries()
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
